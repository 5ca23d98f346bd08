"""Factors on constants of a twin that nobody measured."""

from dataclasses import dataclass, fields


@dataclass(frozen=True)
class Scales:
    """Factors on constants that nobody measured; 1 where the pump file is right."""

    mount: float = 1.0
    """On the mounting's stiffness."""
    bearing: float = 1.0
    """On the bearings' stiffness."""
    excitation: float = 1.0
    """On the forces of a fault."""
    sensor: float = 1.0
    """On what the sensors read."""
    mount_x: float = 1.0
    """On the mounting's stiffness along x, beside `mount`."""
    mount_y: float = 1.0
    """The same along y."""
    mount_z: float = 1.0
    """The same along z."""
    mount_tilt: float = 1.0
    """The same in tilt about x and y."""
    bearing_1: float = 1.0
    """On the stiffness of the first bearing, beside `bearing`."""
    bearing_2: float = 1.0
    """The same of the second."""
    bearing_3: float = 1.0
    """The same of all further ones, the axial one included."""

    def values(self) -> tuple[float, ...]:
        """The factors in the order of the fields."""
        return tuple(getattr(self, item.name) for item in fields(self))


UNSCALED = Scales()
"""All constants as the pump file says."""
SUPPORTS = slice(4, None)
"""Where the factors on the parts of mounting and bearings stand among those of `Scales`."""
