"""Networks that classify windows, by name: the paper's BiTCN, and whatever joins it in the same
battery of tests.
"""
