"""The march through one revolution with films between core and swash plate, and its adjoint, as machine code.

The core, everything but the slippers' films, is linear: over a step in which the film forces P run linearly it goes
exactly from x to Phi x + driven + before P + after P+. P+ is what the films exert at the end of the step, so it is
solved for there: P+ = sum_j c_j N_j, N_j = w_j (a_j - c_j . E P+) where slipper j touches and 0 where it does not, by
Newton's method on which slippers touch. Loops are written out, for arrays made within a step cost more than the step.
"""

from typing import no_type_check

import numpy as np

from swashtwin.foundation import compiled

MOST_CHANGES = 60
"""Newton iterations of one step before it counts as failed; one or two are usual."""


@compiled
@no_type_check
def add_product(transposed, vector, out):
    """Add to `out` the matrix whose transpose is given, times `vector`."""
    for j in range(vector.size):
        factor = vector[j]
        for i in range(out.size):
            out[i] += transposed[j, i] * factor


@compiled
@no_type_check
def solve_small(matrix, right, out):
    """Solve one equation, or three by Cramer's rule."""
    if right.size == 1:
        out[0] = right[0] / matrix[0, 0]
        return
    determinant = 0.0
    out[:] = 0.0
    for i in range(3):
        for j in range(3):  # cofactor of element i, j
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            cofactor = matrix[a, c] * matrix[b, d] - matrix[a, d] * matrix[b, c]
            out[j] += cofactor * right[i]
            if i == 0:
                determinant += cofactor * matrix[0, j]
    for j in range(3):
        out[j] /= determinant


@compiled
@no_type_check
def collect(free, weights, directions, softening, touching, matrix, right):
    """Equations of the film forces, given which slippers are touching."""
    count, size = directions.shape
    right[:] = 0.0
    matrix[:] = 0.0
    for a in range(size):
        matrix[a, a] = 1.0
    for j in range(count):
        if not touching[j]:
            continue
        for a in range(size):
            share = weights[j] * directions[j, a]
            right[a] += share * free[j]
            for b in range(size):
                for c in range(size):
                    matrix[a, b] += share * directions[j, c] * softening[c, b]


@compiled
@no_type_check
def regroup(free, directions, softening, force, touching):
    """Note which slippers touch under the film forces; whether any has changed."""
    count, size = directions.shape
    changed = False
    for j in range(count):
        left = free[j]
        for a in range(size):
            for b in range(size):
                left -= directions[j, a] * softening[a, b] * force[b]
        if (left > 0) != touching[j]:
            touching[j] = left > 0
            changed = True
    return changed


@compiled
@no_type_check
def release(near, film, recess, velocity, directions, free):
    """Fill what each film would exert per weight if its own force gave no way; `near` is K d + C d' by coordinate."""
    for j in range(free.size):
        free[j] = -film[2] * (film[0] * recess[j] + film[1] * velocity[j])
        for a in range(near.size):
            free[j] -= directions[j, a] * near[a]


@compiled
@no_type_check
def march(phi_t, driven, before_t, after_t, strain, slipper, recess, film, one_sided, states, forces, touch):
    """Fill states and film forces of one revolution from states[0]; how many steps have failed.

    `strain` takes a state to K d + C d' of the coordinates; `slipper` holds weights and, behind them, directions;
    `recess` displacements and velocities.
    """
    size, count = strain.shape[0], touch.shape[1]
    steps, failed = driven.shape[0], 0
    give, rigid = np.zeros((size, size)), np.zeros((size, size))
    for b in range(size):
        add_product(strain.T, after_t[b], give[:, b])
    matrix, right, near, free = np.zeros((size, size)), np.zeros(size), np.zeros(size), np.zeros(count)
    touching = np.ones(count, dtype=np.bool_)
    for k in range(steps + 1):
        here = k % steps
        softening = give if k > 0 else rigid
        if k > 0:
            states[k] = driven[k - 1]
            add_product(phi_t, states[k - 1], states[k])
            add_product(before_t, forces[k - 1], states[k])
        near[:] = 0.0
        add_product(strain.T, states[k], near)
        weights, directions = slipper[here, 0], slipper[here, 1:].T
        release(near, film, recess[here, 0], recess[here, 1], directions, free)
        is_consistent = False
        for _ in range(MOST_CHANGES):
            collect(free, weights, directions, softening, touching, matrix, right)
            solve_small(matrix, right, forces[k])
            is_consistent = not (one_sided and regroup(free, directions, softening, forces[k], touching))
            if is_consistent:
                break
        failed += not is_consistent
        touch[k] = touching
        if k > 0:
            add_product(after_t, forces[k], states[k])
    return failed


@compiled
@no_type_check
def march_back(phi, before, after, strain, stiffness, wanted, start, adjoints, pulls):
    """Fill the adjoints of states and film forces of one revolution, backward from `start` at its end."""
    steps, size = wanted.shape[0], strain.shape[0]
    give, matrix, right = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    strained = np.zeros(size)
    for a in range(size):
        add_product(after, strain[a], give[a])
    following = start
    for k in range(steps - 1, -1, -1):
        adjoints[k] = wanted[k]
        add_product(phi, following, adjoints[k])
        right[:] = 0.0
        add_product(before, following, right)
        add_product(after, adjoints[k], right)
        matrix[:] = 0.0
        for a in range(size):
            matrix[a, a] = 1.0
            for b in range(size):
                for c in range(size):
                    matrix[a, b] += give[c, a] * stiffness[k, c, b]
        solve_small(matrix, right, pulls[k])
        strained[:] = 0.0
        add_product(stiffness[k], pulls[k], strained)
        add_product(strain, -strained, adjoints[k])
        following = adjoints[k]
