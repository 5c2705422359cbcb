"""The numbers that the paper prints in its table "Performance Comparison", as they stand there.

Seconds of planning, optimisation and in total, on its own machine and maps. Its total of the network on map (a) is not
the sum of the other two, 7.347.
"""

from __future__ import annotations

Seconds = tuple[float, float, float]  # planning, optimisation, total [s]

PAPER: dict[str, dict[str, Seconds]] = {
    "map_a": {
        "hybrid_astar": (4.487, 5.549, 10.036),
        "rrt_star": (0.167, 23.641, 23.808),
        "gnn": (0.695, 6.652, 8.347),
    },
    "map_b": {
        "hybrid_astar": (3.988, 4.870, 8.858),
        "rrt_star": (0.284, 15.904, 16.188),
        "gnn": (0.709, 6.956, 7.665),
    },
    "map_c": {
        "hybrid_astar": (1.089, 8.134, 9.223),
        "rrt_star": (0.162, 9.675, 9.837),
        "gnn": (0.691, 2.874, 3.565),
    },
    "map_d": {
        "hybrid_astar": (1.756, 8.137, 9.893),
        "rrt_star": (0.152, 13.948, 14.100),
        "gnn": (0.687, 8.507, 9.194),
    },
}
