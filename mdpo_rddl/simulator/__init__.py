"""The exact model, many episodes side by side, on numpy alone.

Its vector environment is registered with Gymnasium:
`gymnasium.make_vec("mdpo_rddl.simulator:mdpo_rddl/RDDL-v0", problem="HVAC_ippc2023", instance=4)`.
"""

import gymnasium

gymnasium.register(
    "mdpo_rddl/RDDL-v0", vector_entry_point="mdpo_rddl.simulator.vector_env:make_vec"
)
