"""Studies: questions asked of the localizer on data with ground truth. Each gives a report of tables."""
