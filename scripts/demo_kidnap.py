"""Carried away every ten images, odometry silent: the robot gets lost, notices, and finds back. Writes a report and a moving picture.

    python scripts/demo_kidnap.py [DATASET]

Slowed down as in demo_relocalize.py.
"""

import sys

from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.report import print_metrics, read_results
from panoloc_mcl.tools.report.figures import Shot, animation
from panoloc_mcl.tools.runs.pipeline import run

settings = {
    "name": "demo_kidnap",
    "dataset": sys.argv[1] if len(sys.argv) > 1 else "hall",
    "sequences": ["evening_00"],
    "kidnap": {"every_frames": 10},
    "observation": {"votes": {"tolerance": 0.3, "refinement": {"enabled": False}}},
    "localizer": {
        "initial": "known_pose",
        "monte_carlo": {"particles": 5000, "recovery": {"max_share": 0.1}},
        "status": {"lost_match": 0.3},
    },
}

outcome = run(config_from_mapping(settings, "demo"))
print_metrics(outcome.metrics, beside_paper=False)

results = read_results(outcome.folder)
record = results.records[0]
for stamp, status, kidnapped in zip(record.times, record.status, record.kidnapped, strict=True):
    print(f"{stamp - record.times[0]:7.1f} s  {'carried away, ' if kidnapped else ''}{status}")

animation(Shot.of(results, record), outcome.folder / "demo.gif")
print(outcome.folder / "demo.gif")
print(outcome.folder / "report.html")
