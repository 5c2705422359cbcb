"""Pictures of a plan: the map, the states over time and a replay in three dimensions."""

from drake_gnnocp.pictures.map_plot import draw_map, plan_figure, save_plan_picture
from drake_gnnocp.pictures.plan_card import plan_html
from drake_gnnocp.pictures.replay import save_replay
from drake_gnnocp.pictures.states_plot import draw_states, save_states_picture, states_figure

__all__ = [
    "draw_map",
    "draw_states",
    "plan_figure",
    "plan_html",
    "save_plan_picture",
    "save_replay",
    "save_states_picture",
    "states_figure",
]
