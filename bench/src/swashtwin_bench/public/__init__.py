"""Public sets of recordings, read as published and asked what an honest split leaves of the usual
score.
"""
