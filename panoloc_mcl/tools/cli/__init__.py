"""The command line: ``panoloc COMMAND``. No other part of the package imports it.

Commands import what they need when they run, so that ``--help`` answers at once.
"""
