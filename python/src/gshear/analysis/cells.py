"""The cell of every grain in a tessellation of the sample."""

from __future__ import annotations

import numpy as np
import xarray as xr

from ..frames import Frame
from ._given import attributes, grain_rows, has_walls, product
from .contacts import grain_volumes


def solid_fractions(frame: Frame, *, radical: bool = True) -> xr.DataArray:
    """Returns the solid fraction of every grain: its volume over that of its cell, [grain].

    The cells are those of the Laguerre (radical) tessellation, whose faces are at equal tangents to
    both grains, so that no cell cuts a grain (Gellatly & Finney, J. Non-Cryst. Solids 50, 313,
    1982); with `radical=False` those of Voronoi, for grains of one size. They are computed by
    pyvoro2, which contains Voro++ (Rycroft, Chaos 19, 041111, 2009): `pip install
    'gshear[voronoi]'`. Disks that touch overlap a little, as do spheres.

        phi = analysis.solid_fractions(run.frame(-1))
        plots.grain_map(ax, run, -1, phi)

    Args:
        frame: The frame.
        radical: Whether sizes count.

    Returns:
        [grain], with the cells' volumes (m³; areas of disks, m²) as the coordinate `cell`. NaN of
        grains of walls, of removed ones, and of those at a free surface; the cells at a flat wall
        end there. In a periodic cell Σ cell is its volume.

    Raises:
        ModuleNotFoundError: pyvoro2 is not installed.
        ValueError: There are no grains.
    """
    try:
        import pyvoro2
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "solid_fractions needs pyvoro2: pip install 'gshear[voronoi]'", name="pyvoro2"
        ) from error
    rows = np.flatnonzero(~frame.removed)
    if not len(rows):
        raise ValueError(f"frame {frame.index} has no grains")
    box, d, gradient = frame.box, frame.dimension, frame.box.gradient
    # In units of a diameter; a layer of that depth holds disks.
    unit = 2 * float(frame.radius[rows].mean())
    place, radius = box.wrap(frame.position[rows]) / unit, frame.radius[rows] / unit
    edges, vectors = box.edges / unit, box.vectors / unit
    if d == 2:
        edges = np.array([*edges[:2], 1.0])
        vectors[2] = (0.0, 0.0, 1.0)
        place[:, 2] = 0.5
    if has_walls(frame):
        height = place[:, gradient]
        low, high = min(height - radius), max(height + radius)
        bounds = [(0.0, float(edge)) for edge in edges]
        bounds[gradient] = (
            min(0.0, min(height)) if box.planes[0] else float(low),
            max(edges[gradient], max(height)) if box.planes[1] else float(high),
        )
        domain = pyvoro2.OrthorhombicCell(tuple(bounds), tuple(a != gradient for a in range(3)))
    else:
        domain = pyvoro2.PeriodicCell(tuple(tuple(vector) for vector in vectors.tolist()))
    # What Voro++ calls the ends of the box at which no plane is.
    open_ends = {-(2 * gradient + 1 + k) for k in (0, 1) if not box.planes[k]}
    cells = pyvoro2.compute(
        place,
        domain=domain,
        **({"mode": "power", "radii": radius} if radical else {}),
        return_vertices=has_walls(frame),
        return_adjacency=False,
        return_faces=has_walls(frame),
        include_empty=True,
        output="cells",
    )
    cell = np.full(len(frame.radius), np.nan)
    for each in cells:
        is_open = any(face["adjacent_cell"] in open_ends for face in each.get("faces", []))
        if each["volume"] > 0 and not (has_walls(frame) and is_open):
            cell[rows[each["id"]]] = each["volume"] * unit**d
    cell[frame.body != 0] = np.nan
    units = product(frame.units, "radius", d)
    return xr.DataArray(
        grain_volumes(frame) / cell,
        coords={
            "grain": grain_rows(frame),
            "cell": ("grain", cell, attributes("volume of the cell", units)),
        },
        dims="grain",
        name="solid_fraction",
        attrs=attributes("solid fraction of the cell"),
    )
