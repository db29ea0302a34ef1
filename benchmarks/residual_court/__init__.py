"""The residual court: synthetic runs with hidden effects that judge the diagnosis (issue 4, point 6).

The generator (`drives`, `relays`, `densities`, `operators`, `families`, `effects*`, `generator`, `scaling`, `cases`)
imports NumPy, SciPy and Numba only: it shares no code with the links of pzt_ros, and uses other formulas for the same
physics where there are any. `court` runs the diagnosis over its cases and `scoreboard` counts. Everything is simulated.
"""
