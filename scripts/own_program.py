"""Localization inside a program of one's own: a map, a localizer, odometry and images in, poses out.

    python scripts/own_program.py [DATASET] [SEQUENCE]

A recorded drive stands for the robot here; yours calls ``add_odometry`` and ``add_image`` where its drivers deliver.
"""

import sys

from panoloc_mcl import Localizer, read_dataset
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import resolve_dataset
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import answers, recorded

dataset = read_dataset(resolve_dataset(sys.argv[1] if len(sys.argv) > 1 else "hall"))
drive = dataset.sequences[sys.argv[2] if len(sys.argv) > 2 else "evening_00"]
config = RunConfig()

# Once: `PanoramaMap.build(dataset)`, or the same from the cache; on a robot `PanoramaMap.load("hall.panomap")`.
panorama_map = cached_map(dataset, config.observation, config.seed)
localizer = Localizer(panorama_map, config, camera=drive.camera, image_size=drive.image_size)

for image, estimate in answers(localizer, recorded(drive)):
    x, y, heading = estimate.pose
    spread = estimate.covariance.diagonal() ** 0.5
    print(f"{image.timestamp:12.3f}  {estimate.status.value:10}  x {x:7.3f} m  y {y:7.3f} m  heading {heading:6.3f} rad")
    print(f"              standard deviations {1000 * spread[0]:.1f} mm, {1000 * spread[1]:.1f} mm, {spread[2]:.4f} rad")
    if estimate.message:
        print(f"              {estimate.message}")
