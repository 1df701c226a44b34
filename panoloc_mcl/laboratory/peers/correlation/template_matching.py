"""Template matching: OpenCV's normalised correlation of the whole image with every reference at every heading.

J. P. Lewis, "Fast normalized cross-correlation", Vision Interface 1995; `cv2.matchTemplate` with TM_CCOEFF_NORMED. The reference slides
around the circle of the image; the best reference and turn are the answer. No mask, no features: the floor of what an image tells.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.base import Float32, Peer
from panoloc_mcl.laboratory.peers.settings import TemplateMatchingSettings
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas


class TemplateMatchingModel(Peer[TemplateMatchingSettings]):
    """Normalised correlation of grey levels with every reference at every heading (model ``template_matching``)."""

    name = "template_matching"

    @classmethod
    def learn(
        cls, images: Float32, references: ReferencePanoramas, settings: TemplateMatchingSettings, progress: Progress
    ) -> dict[str, NDArray[Any]]:
        """The references' grey levels."""
        progress(1, 1, "templates")
        return {"templates": np.asarray(np.rint(images), dtype=np.uint8)}

    def votes(self, image: Float32) -> Float32:
        """By correlation; negative ones are no vote."""
        grey = np.asarray(np.clip(np.rint(image), 0.0, 255.0), dtype=np.uint8)
        wrapped = np.hstack([grey, grey[:, :-1]])
        found = [cv2.matchTemplate(wrapped, template, cv2.TM_CCOEFF_NORMED)[0] for template in self._arrays["templates"]]
        # Column s of a result: the image turned back by s columns, as at that heading.
        return np.asarray(np.clip(np.stack(found, axis=1), 0.0, 1.0), dtype=np.float32)
