"""The time loop, schedules, frames and the accounting of seconds: no physics.

`model` is the interface of simulators, `time_loop.evolve` advances independent models in lockstep,
`recording` runs it and records frames, `failed_steps` has the limits of failed steps and `step_warnings`
their warnings, `effects` is the registry of effects, `frames` joins models into one surface, `outcome` has
the results, `account` measures seconds.
"""

__all__ = ["account", "effects", "frames", "model", "outcome", "recording", "step_warnings", "time_loop"]
