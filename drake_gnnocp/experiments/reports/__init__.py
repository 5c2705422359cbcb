"""Reports that are made from the runs of the benchmark."""
