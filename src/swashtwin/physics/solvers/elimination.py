"""Compiled solution of many small symmetric systems (M s^2 + C s + K) x = f, side by side.

L D L^T of `LANES` systems at a time, without pivots, in groups of coordinates that nothing couples. Every lane does the
same operations in the same order whatever its neighbors are, so that a batch gives the bits of its members.
"""

from typing import no_type_check

import numpy as np

from swashtwin.foundation import compiled

LANES = 32
"""Systems that are eliminated side by side, so that the vector unit is full."""
GROWTH = 1e3
"""Growth of an entry beyond its natural size at which elimination without pivots is given up."""
ROUNDING = 1e-14
"""Entry, or difference between K_ij and K_ji, that is nothing but rounding; in units of the root of K_ii K_jj."""


@compiled
@no_type_check
def tidy(matrices, tidied):
    """Whether every matrix is symmetric to rounding, and finite; `tidied` gets them without entries of that size."""
    for b in range(matrices.shape[0]):
        for i in range(matrices.shape[1]):
            for j in range(i + 1):
                entry = matrices[b, i, j]
                size = ROUNDING * np.sqrt(abs(matrices[b, i, i] * matrices[b, j, j]))
                if not abs(entry - matrices[b, j, i]) <= size:
                    return False
                tidied[b, i, j] = tidied[b, j, i] = entry if abs(entry) > size else 0.0
    return True


@compiled
@no_type_check
def coupled_groups(mass, damping, stiffness, order, ends):
    """Count of the groups of coordinates that no matrix of the batch couples; fills in members and ends of each."""
    n = mass.shape[0]
    coupled, group = np.zeros((n, n), np.bool_), np.arange(n)
    _couple(mass, coupled)
    for matrices in (damping, stiffness):
        for matrix in matrices:
            _couple(matrix, coupled)
    _join(coupled, group)
    filled, count = 0, 0
    for first in range(n):
        if group[first] == first:
            for i in range(n):
                if group[i] == first:
                    order[filled] = i
                    filled += 1
            ends[count] = filled
            count += 1
    return count


@compiled
@no_type_check
def _couple(matrix, coupled):
    """Note what `matrix` couples."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[0]):
            coupled[i, j] |= matrix[i, j] != 0


@compiled
@no_type_check
def _join(coupled, group):
    """Give each coordinate the least coordinate of its group; passes over all couplings until nothing changes."""
    before = -1
    while before != group.sum():
        before = group.sum()
        for i in range(group.size):
            for j in range(group.size):
                if coupled[i, j]:
                    group[i] = group[j] = min(group[i], group[j])


@compiled
@no_type_check
def _fill(mass, damping, stiffness, re, im, size, at, sr, si, members):
    """Lower triangles of one group, and how large an entry of each row may grow."""
    for i in range(members.shape[0]):
        row = members[i]
        for j in range(i + 1):
            column = members[j]
            inertia = mass[row, column]
            for k in range(LANES):
                viscous = damping[at[0, k], row, column]
                elastic = stiffness[at[1, k], row, column]
                re[i, j, k] = elastic + sr[k] * viscous + (sr[k] * sr[k] - si[k] * si[k]) * inertia
                im[i, j, k] = si[k] * viscous + 2 * sr[k] * si[k] * inertia
        for k in range(LANES):
            rate = abs(sr[k]) + abs(si[k])
            natural = abs(stiffness[at[1, k], row, row]) + rate * abs(damping[at[0, k], row, row])
            size[i, k] = GROWTH * (natural + rate * rate * abs(mass[row, row]))


@compiled
@no_type_check
def _eliminate(re, im, yr, yi, size, n):
    """L below the diagonal, inverse pivots on it, what L was before its division above; y becomes L^-1 y."""
    for j in range(n):
        for k in range(LANES):
            inverse = 1 / (re[j, j, k] * re[j, j, k] + im[j, j, k] * im[j, j, k])
            re[j, j, k] = re[j, j, k] * inverse
            im[j, j, k] = -im[j, j, k] * inverse
        for i in range(j + 1, n):
            for k in range(LANES):  # short loops over few arrays, which the compiler turns into vector code
                re[j, i, k] = re[i, j, k]
                im[j, i, k] = im[i, j, k]
            for k in range(LANES):
                re[i, j, k] = re[j, i, k] * re[j, j, k] - im[j, i, k] * im[j, j, k]
                im[i, j, k] = re[j, i, k] * im[j, j, k] + im[j, i, k] * re[j, j, k]
            for k in range(LANES):
                product = (abs(re[i, j, k]) + abs(im[i, j, k])) * (abs(re[j, i, k]) + abs(im[j, i, k]))
                size[i, k] = size[i, k] if product <= size[i, k] else -1.0
            for t in range(j + 1, i + 1):
                for k in range(LANES):
                    re[i, t, k] -= re[i, j, k] * re[j, t, k] - im[i, j, k] * im[j, t, k]
                    im[i, t, k] -= re[i, j, k] * im[j, t, k] + im[i, j, k] * re[j, t, k]
            for k in range(LANES):
                yr[i, k] -= re[i, j, k] * yr[j, k] - im[i, j, k] * yi[j, k]
                yi[i, k] -= re[i, j, k] * yi[j, k] + im[i, j, k] * yr[j, k]


@compiled
@no_type_check
def _substitute(re, im, yr, yi, n):
    """y becomes L^-T D^-1 y."""
    for j in range(n - 1, -1, -1):
        for k in range(LANES):
            a, b = yr[j, k], yi[j, k]
            yr[j, k] = a * re[j, j, k] - b * im[j, j, k]
            yi[j, k] = a * im[j, j, k] + b * re[j, j, k]
        for i in range(j + 1, n):
            for k in range(LANES):
                yr[j, k] -= re[i, j, k] * yr[i, k] - im[i, j, k] * yi[i, k]
                yi[j, k] -= re[i, j, k] * yi[i, k] + im[i, j, k] * yr[i, k]


@compiled
@no_type_check
def solve_symmetric(mass, damping, stiffness, s, force, motion, failed):
    """Fill in `motion`, and mark in `failed` the systems that need pivots; a leading axis of 1 is shared by all."""
    n_batch, n_lines, n = motion.shape
    order, ends = np.empty(n, np.int64), np.empty(n, np.int64)
    count = coupled_groups(mass, damping, stiffness, order, ends)
    re, im = np.empty((n, n, LANES)), np.empty((n, n, LANES))
    yr, yi, size = np.empty((n, LANES)), np.empty((n, LANES)), np.empty((n, LANES))
    sr, si = np.empty(LANES), np.empty(LANES)
    at, line = np.empty((4, LANES), np.int64), np.empty(LANES, np.int64)
    for first in range(0, n_batch * n_lines, LANES):
        lanes = min(LANES, n_batch * n_lines - first)
        for k in range(LANES):
            batch = (first + min(k, lanes - 1)) // n_lines
            line[k] = (first + min(k, lanes - 1)) % n_lines
            at[0, k] = batch if damping.shape[0] > 1 else 0
            at[1, k] = batch if stiffness.shape[0] > 1 else 0
            at[2, k] = batch if force.shape[0] > 1 else 0
            at[3, k] = batch
            value = s[batch if s.shape[0] > 1 else 0, line[k]]
            sr[k], si[k] = value.real, value.imag
        for group in range(count):
            members = order[(ends[group - 1] if group > 0 else 0) : ends[group]]
            for i in range(members.shape[0]):
                for k in range(LANES):
                    value = force[at[2, k], line[k], members[i]]
                    yr[i, k], yi[i, k] = value.real, value.imag
            _fill(mass, damping, stiffness, re, im, size, at, sr, si, members)
            _eliminate(re, im, yr, yi, size, members.shape[0])
            _substitute(re, im, yr, yi, members.shape[0])
            for i in range(members.shape[0]):
                for k in range(lanes):
                    motion[at[3, k], line[k], members[i]] = complex(yr[i, k], yi[i, k])
                    if not (size[i, k] >= 0 and np.isfinite(yr[i, k]) and np.isfinite(yi[i, k])):
                        failed[at[3, k], line[k]] = True
