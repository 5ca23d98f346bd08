"""The paper's experiments as the paper describes them, and one page with its figures beside
ours.
"""
