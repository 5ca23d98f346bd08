"""Ways of computing the same spectrum loss and its gradient, our own among them, for
``benchmarks/simulator.py``.
"""
