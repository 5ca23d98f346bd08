"""From time to turns: where the shaft stood at each reading, and the recording along its angle.

A speed that wanders by half a percent smears the line at order 100 over half an order; along the shaft's angle it
stands still. The angle comes from a tachometer channel (`tachometer_speed`), from a line of the signal itself
(`tracked_speed`; `piston_pass_angle` takes the clearest of a pump's own), or from the speed that somebody wrote down
(`stated_angle`).
"""

from swashtwin.order_domain.pistons import piston_pass_angle
from swashtwin.order_domain.resampling import resampled_by_angle
from swashtwin.order_domain.shaft_angle import ShaftAngle, stated_angle
from swashtwin.order_domain.tachometer import tachometer_speed
from swashtwin.order_domain.tracking import tracked_speed

__all__ = ["ShaftAngle", "piston_pass_angle", "resampled_by_angle", "stated_angle", "tachometer_speed", "tracked_speed"]
