"""What the commands of simulators share: scene input, the run with its trajectory, plots.

`scene_run` goes from a scene to a summary; `simulate` runs the models and writes frames; `first_steps`
predicts their cost.
"""

__all__ = ["first_steps", "options", "plot", "scene_input", "scene_run", "simulate"]
