"""Solvers of M x'' + C x' + K x = Q, differentiable and batched.

In steady state every solver works line by line: forces and motions are one-sided complex amplitudes of the shaft orders
``k = 0, 1, ...``, with ``x(t) = X_0 + Re sum_k X_k exp(i k omega t)``.

- `HarmonicBalance` is exact for the equations: one `receptance` a line.
- `RK4` is the periodic steady state that the fourth-order Runge-Kutta recursion itself reaches at its step: on a linear
  system the recursion is a fixed map, whose response to each line is that of four receptances
  (docs/explanation/simulator.md).
- `periodic_steady_state` adds parts of K and C that turn with the shaft to either.

Everything takes leading batch axes, follows the device and the precision of what it is given, and has exact
derivatives that keep forces and motions, never a matrix a line. A batch gives each of its members what it would get
alone.

Single precision is off by up to 1e-4 of the largest motion in a line (2e-6 in the median of lines): the damping of a
film exceeds what decides the motion by orders of magnitude.
"""
