"""Networks that classify windows, by name: the paper's BiTCN and its rivals."""
