"""Conventions checked by the data: the images show which way angles, axes, columns and clocks run.

Two images taken near each other say, without any map, how the camera turned between them and which way it moved: what lies ahead and
behind stays where it is in the panorama, what lies abeam moves most. So every way to read the poses that are written beside them can
be tried, and the one that fits far better than what is written is named.
"""

from panoloc_mcl.tools.conventions.drives import drive_findings
from panoloc_mcl.tools.conventions.references import reference_findings
from panoloc_mcl.tools.conventions.stamps import stamp_findings
from panoloc_mcl.tools.conventions.whole import convention_findings

__all__ = ["convention_findings", "drive_findings", "reference_findings", "stamp_findings"]
