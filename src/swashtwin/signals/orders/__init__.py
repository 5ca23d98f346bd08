"""From time to turns: where the shaft stood at each sample, and the recording along its angle.

A speed that wanders by half a percent smears the line at order 100 over half an order; along the shaft's angle it
stands still. The angle comes from a tachometer channel (`tachometer_speed`), from a line of the signal itself
(`tracked_speed`; `piston_pass_angle` takes the clearest of a pump's own), or from the speed that somebody wrote down
(`stated_angle`).
"""
