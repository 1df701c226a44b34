"""Hours of driving with everything going wrong: random faults in images, stamps and odometry, and what must hold after every image."""

from panoloc_mcl.laboratory.studies.robustness.soak.faults import IMAGE_FAULTS
from panoloc_mcl.laboratory.studies.robustness.soak.findings import MOST_IN_ROW, Findings
from panoloc_mcl.laboratory.studies.robustness.soak.study import Mode, soak, study

__all__ = ["IMAGE_FAULTS", "MOST_IN_ROW", "Findings", "Mode", "soak", "study"]
