"""The command line: ``panoloc COMMAND``. Nothing else of the package knows of it.

Commands import what they need when they run, so that ``--help`` answers at once.
"""
