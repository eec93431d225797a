"""The time loop, schedules, frames and the accounting of seconds: no physics.

`model` is what a simulator hands over, `time_loop.evolve` advances independent models in lockstep, `effects`
is the registry of effects, `frames` joins models into one surface, `outcome` collects the results,
`step_warnings` words those of failed steps.
"""

__all__ = ["account", "effects", "frames", "model", "outcome", "recording", "step_warnings", "time_loop"]
