"""From windows to a fitted classifier: `fit`, its settings, and checkpoints that continue bit for
bit.
"""
