"""Where the first guess of the optimal control problem comes from."""

from drake_gnnocp.guesses.base import Given, Guess, GuessSource, GuessUnavailable, NoGuess
from drake_gnnocp.guesses.hybrid_astar import HybridAStar
from drake_gnnocp.guesses.learned import Learned
from drake_gnnocp.guesses.rrt_star import RrtStar
from drake_gnnocp.guesses.straight import Straight

__all__ = [
    "Given",
    "Guess",
    "GuessSource",
    "GuessUnavailable",
    "HybridAStar",
    "Learned",
    "NoGuess",
    "RrtStar",
    "Straight",
]
