"""Gradient flows of polylines: curvature flow, area-preserving flow and elastic flow (chapters 1 and 3).

`polygon` holds the discrete length, area and elastic energy with their gradients, `flow` the time steps,
`normal_step` the linear system of one, `flow_terms` the options of a flow and its state, `setup` builds a
flow from curves and options, `report` measures a run, `flow_run` joins the two for the command and the
library.
"""

__all__ = ["flow", "flow_run", "flow_terms", "normal_step", "polygon", "report", "setup"]
