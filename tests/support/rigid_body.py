"""Motions of a pump that strain nothing, against which tests hold forces and stiffness."""

import numpy as np
from jaxtyping import Float

from swashtwin.physics.dynamics import N_DOF, Dof
from swashtwin.pump import Pump


def rigid_motions(pump: Pump) -> Float[np.ndarray, "13 5"]:
    """The five motions of the pump as one rigid body: x, y, z, and rotations about x and y through
    the origin.
    """
    motions = np.zeros((N_DOF, 5))
    centers = {
        Dof.SHELL_X: pump.positions.shell,
        Dof.ROTOR_X: pump.positions.rotor,
        Dof.RETAINER_X: 0.0,
    }

    for first, center in centers.items():
        motions[first : first + 3, :3] = np.eye(3)
        for axis in (0, 1):
            motions[first : first + 3, 3 + axis] = np.cross(np.eye(3)[axis], [0.0, 0.0, center])

    for axis in (0, 1):
        motions[Dof.SHELL_TILT_X + axis, 3 + axis] = motions[Dof.ROTOR_TILT_X + axis, 3 + axis] = (
            1.0
        )

    return motions
