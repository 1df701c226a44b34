"""A view synthesised at a place beside the reference taken there, which the map did not see. Writes a PNG.

    python scripts/show_synthesis.py [--dataset PATH_OR_NAME] [--reference N] [-o FILE]

From top to bottom: the reference that was left out; the view synthesised there from the others; the nearest reference as it is.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import cv2
import numpy as np

from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.references import ReferencePanoramas, read_references
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, sweep_profiles
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset


def without(references: ReferencePanoramas, index: int) -> ReferencePanoramas:
    """All references but one."""
    return replace(
        references,
        pixels=np.delete(references.pixels, index, axis=0),
        positions=np.delete(references.positions, index, axis=0),
        names=tuple(name for i, name in enumerate(references.names) if i != index),
    )


def main() -> None:
    """Write the picture and print how well it agrees."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="hall", help="path of a data set, or the name of an embedded one")
    parser.add_argument("--reference", type=int, default=7, help="the one that is left out")
    parser.add_argument("-o", "--output", default="synthesis.png")
    arguments = parser.parse_args()
    settings = VotesSettings()
    references = read_references(read_dataset(resolve_dataset(arguments.dataset)).references)
    others = without(references, arguments.reference)
    height = others.camera_height_m
    if height is None:
        raise SystemExit("the data set does not say the camera's height; add camera.height_m to dataset.yaml")
    synthesizer = ViewSynthesizer(others, sweep_profiles(others, height, settings), height)
    position = references.positions[arguments.reference]
    nearest = int(np.argmin(np.hypot(*(others.positions - position).T)))
    view = synthesizer.view(nearest, position, synthesizer.profile_at(nearest, position))
    truth, neighbour = references.panorama(arguments.reference), others.panorama(nearest)
    z = {name: orientations(image, settings)[0] for name, image in (("truth", truth), ("view", view), ("raw", neighbour))}
    for name in ("view", "raw"):
        common = np.sum((z["truth"].conj() * z[name]).real)
        both = np.sqrt(np.sum(np.abs(z["truth"][z[name] != 0]) ** 2) * np.sum(np.abs(z[name][z["truth"] != 0]) ** 2))
        print(f"cosine with the reference left out: {name} {common / both:.2f}")
    print(f"distance to the nearest reference: {np.hypot(*(others.positions[nearest] - position)):.2f} m")
    line = np.full((4, truth.pixels.shape[1]), 255.0, dtype=np.float32)
    stack = np.vstack([truth.pixels, line, view.pixels, line, neighbour.pixels])
    enlarged = cv2.resize(stack, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(arguments.output, np.clip(enlarged, 0, 255).astype(np.uint8))


if __name__ == "__main__":
    main()
