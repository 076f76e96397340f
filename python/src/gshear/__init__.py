"""Reads runs of gshear-mpi, calls gshear-reduce for what is missing, and plots both.

    from gshear import Run

    with Run("out/plane-shear-2d") as run:
        print(run.scene["contact.friction"], run.mean("stress_ratio").mean)
        contacts = run.contacts(-1)
        print(contacts.normal_force.mean(), run.dmin(-1))

Names of columns are those of the files (`docs/reference/file-formats.md` of gshear-mpi), units are
SI, in 2D per unit depth; runs in a periodic box have the units of their scene.
"""

from importlib.metadata import version

from .box import Box
from .errors import GshearError, NoSuchNameError, ProgramFailedError, ProgramNotFoundError, RunError
from .frames import Contacts, Frame, WallContacts
from .movies import movie
from .programs import simulate
from .run import Frames, Observable, Run
from .scene import Scene
from .sweep import Sweep

__version__ = version("gshear")
__all__ = [
    "Box",
    "Contacts",
    "Frame",
    "Frames",
    "GshearError",
    "NoSuchNameError",
    "Observable",
    "ProgramFailedError",
    "ProgramNotFoundError",
    "Run",
    "RunError",
    "Scene",
    "Sweep",
    "WallContacts",
    "movie",
    "simulate",
]
