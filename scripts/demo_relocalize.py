"""Finding itself in the evening with a map of noon: nothing known of the pose. Writes a report and a moving picture.

    python scripts/demo_relocalize.py [DATASET]

The localizer is slowed down so that there is something to watch: without refinement, with cautious votes, and with few particles
drawn from images. By default the first image is enough.
"""

import sys

from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.report import print_metrics, read_results
from panoloc_mcl.tools.report.figures import Shot, animation
from panoloc_mcl.tools.runs.pipeline import run

settings = {
    "name": "demo_relocalize",
    "dataset": sys.argv[1] if len(sys.argv) > 1 else "hall",
    "sequences": ["evening_00"],
    "observation": {"votes": {"tolerance": 0.3, "refinement": {"enabled": False}}},
    "localizer": {"monte_carlo": {"particles": 5000, "recovery": {"max_share": 0.02}}},
}

outcome = run(config_from_mapping(settings, "demo"))
print_metrics(outcome.metrics, beside_paper=False)

results = read_results(outcome.folder)
animation(Shot.of(results, results.records[0]), outcome.folder / "demo.gif")
print(outcome.folder / "demo.gif")
print(outcome.folder / "report.html")
