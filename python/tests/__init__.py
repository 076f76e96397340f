"""Tests of the package, through the real programs."""

from .environment import restore

# Before h5py reads its settings.
restore()
