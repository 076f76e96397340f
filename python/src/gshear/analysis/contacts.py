"""Forces, fabric and stresses of contacts."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..frames import Contacts, Frame
from ._given import attributes, frame_list, grain_rows, numbers, product

Array = NDArray[np.float64]


def fabric(normals: ArrayLike, weights: ArrayLike | None = None) -> Array:
    """Returns the fabric tensor ⟨n ⊗ n⟩ of unit vectors, [3, 3]; its trace is 1.

    Oda, Soils Found. 22, 96 (1982). An isotropic fabric is 1/2 along x and y for disks, 1/3 along
    every axis for spheres.

    Args:
        normals: [K, 3], such as `contacts.normal`.
        weights: [K], such as normal forces; by default all contacts count the same.
    """
    n = np.asarray(normals, dtype=np.float64)
    w = np.ones(len(n)) if weights is None else np.asarray(weights, dtype=np.float64)
    tensor: Array = (n * w[:, None]).T @ n / w.sum()
    return tensor


def rattlers(contacts: Contacts, least: int | None = None) -> NDArray[np.bool_]:
    """Finds the free grains that nothing holds, [N].

    Grains with fewer contacts than can balance them are left out, with their contacts, until there
    are none. Grains that were removed are none of them.

    With friction two contacts balance a disk or a sphere: equal and opposite forces along the line
    through both points of contact, which give no torque, if that line is within both cones of
    friction (Agnolin & Roux, Phys. Rev. E 76, 061302, 2007, count such spheres). Without friction
    forces point to the centre, and one contact more than the dimension is needed (O'Hern et al.,
    Phys. Rev. E 68, 011306, 2003). Lee & Hurley's rattlers, those of `Run.dmin`, are others: grains
    with as few contacts as the dimension or fewer, counted once.

    Args:
        contacts: Contacts of a frame.
        least: Number of contacts that hold a grain; by default 2 if the scene has friction
            (`frame.friction`), else one more than the dimension.
    """
    frame, pairs = contacts.frame, contacts.pairs
    if least is None:
        least = 2 if frame.friction > 0 else frame.dimension + 1
    needed = np.where(frame.body == 0, least, 0)
    needed[frame.removed] = 0
    held = np.ones(len(needed), dtype=bool)
    while True:
        ends = pairs[held[pairs].all(axis=1)].ravel()
        still = held & (np.bincount(ends, minlength=len(held)) >= needed)
        if (still == held).all():
            return ~held
        held = still


def force_distributions(
    frames: Frame | Iterable[Frame], *, bins: int | ArrayLike = 60
) -> xr.Dataset:
    """Returns the probability densities of normal and tangential forces over their means.

    Radjai et al. (Phys. Rev. Lett. 77, 274, 1996): F_n/⟨F_n⟩ and |F_t|/⟨|F_t|⟩, with the means of
    each frame, over all contacts of free grains. The integral over the force is 1.

        analysis.force_distributions(run.frames[-20:])["normal"].plot(yscale="log")

    Args:
        frames: A frame, or frames of one run.
        bins: Number of intervals from 0 (or the greatest attraction) to the greatest force; or the
            edges of the intervals, which need not hold all forces.

    Returns:
        [force]: `normal` and `tangential`, densities, and `normal_count` and `tangential_count`,
        numbers of contacts, with `force`, the middles of the intervals over the mean. The
        attribute `mean` of both densities is the mean force (N; N/m for disks). Without tangential
        forces their density is NaN.

    Raises:
        ValueError: A frame has no contacts, or no mean normal force.
    """
    listed = frame_list(frames)
    forces: dict[str, list[Array]] = {"normal": [], "tangential": []}
    means: dict[str, list[float]] = {"normal": [], "tangential": []}
    for frame in listed:
        contacts = frame.contacts
        free = (frame.body[contacts.pairs] == 0).any(axis=1)
        if not free.any():
            raise ValueError(f"frame {frame.index} has no contacts, so no forces")
        tangential = _magnitude(contacts.tangential_force)
        for name, force in (("normal", contacts.normal_force), ("tangential", tangential)):
            mean = float(force[free].mean())
            if name == "normal" and not mean > 0:
                raise ValueError(f"frame {frame.index} has no pressure: ⟨F_n⟩ is {mean:g}")
            means[name].append(mean)
            # Without friction there are none.
            forces[name].append(force[free] / mean if mean > 0 else np.empty(0))
    values = {name: np.concatenate(parts) for name, parts in forces.items()}
    if np.ndim(bins) == 0:
        count = int(np.asarray(bins))
        if count < 1:
            raise ValueError(f"bins is {count}; give one or more, or edges")
        joined = np.concatenate(list(values.values()))
        edges = np.linspace(min(0.0, joined.min()), joined.max(), count + 1)
    else:
        edges = numbers(bins)
    units = product(listed[0].contacts.units, "normal_force", 1)
    found = {}
    for name, numbers_of in values.items():
        counts = np.histogram(numbers_of, edges)[0]
        with np.errstate(invalid="ignore"):
            density = counts / np.diff(edges) / len(numbers_of)
        mean = float(np.mean(means[name]))
        named = attributes(f"density of {name} forces over their mean", mean=mean)
        found[name] = ("force", density, named | ({} if units is None else {"mean_units": units}))
        found[f"{name}_count"] = ("force", counts, attributes("number of contacts"))
    middles = (edges[1:] + edges[:-1]) / 2
    return xr.Dataset(
        found, coords={"force": ("force", middles, attributes("force over its mean"))}
    )


def mobilisation(contacts: Contacts, *, attraction: ArrayLike | None = None) -> xr.DataArray:
    """Returns how much of the friction of every contact is mobilised, |F_t|/(μ (F_n + F_c)), [K].

    1 at Coulomb's limit (Staron, Vilotte & Radjai, Phys. Rev. Lett. 89, 204302, 2002). μ is that of
    the materials of the pair. Laws that cut the spring alone, such as `lee-hurley`, add their
    damper below the limit, and may exceed it.

    Args:
        contacts: Contacts of a frame.
        attraction: [K] or a number, F_c (N; N/m for disks), required where grains attract each
            other: `docs/reference/laws.md` has it for each adhesion.

    Returns:
        [contact], with the coordinates `i` and `j`, rows of the grains, and `sliding`. NaN where
        F_n + F_c is 0.

    Raises:
        ValueError: The scene has no friction, or attraction is missing.
    """
    frame = contacts.frame
    if not frame.friction > 0:
        raise ValueError("the scene has no friction (contact.friction): nothing is mobilised")
    if frame.attracts and attraction is None:
        raise ValueError(
            "grains of this scene attract each other, so Coulomb's limit is μ (F_n + F_c); "
            "give attraction, the F_c of every contact"
        )
    material = frame["material"] if "material" in frame else np.zeros(len(frame.radius), dtype=int)
    friction = frame.pair_friction[material[contacts.i], material[contacts.j]]
    pressing = contacts.normal_force + (0.0 if attraction is None else np.asarray(attraction))
    limit = friction * pressing
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(limit > 0, _magnitude(contacts.tangential_force) / limit, np.nan)
    return xr.DataArray(
        ratio,
        coords={name: ("contact", contacts[name]) for name in ("i", "j", "sliding")},
        dims="contact",
        name="mobilisation",
        attrs=attributes("mobilised friction"),
    )


def grain_stress(contacts: Contacts, *, volumes: ArrayLike | None = None) -> xr.DataArray:
    """Returns the stress of every grain, [grain, axis, along] (Pa); compression is positive.

    σ = 1/V Σ R n ⊗ f over the contacts of the grain, with flat walls too, symmetric part (Lee &
    Hurley; Christoffersen, Mehrabadi & Nemat-Nasser, J. Appl. Mech. 48, 339, 1981), as
    `gshear-reduce export --fields stress` has it: V is the volume of the grain, in 2D πR². The
    stress of the sample is the sum of V σ over its volume, but for overlaps and the kinetic part.

        pressure = np.trace(analysis.grain_stress(run.contacts(-1)), axis1=1, axis2=2) / 2

    Args:
        contacts: Contacts of a frame.
        volumes: [N], volumes (areas of disks) to divide by in place of the grains' own, such as
            those of their cells: `grain volume / solid_fractions(frame)`.

    Returns:
        Axes are x and y of disks, x, y and z of spheres. 0 of grains without contacts, NaN of
        removed ones.
    """
    frame, d = contacts.frame, contacts.frame.dimension
    own = grain_volumes(frame)
    v = own if volumes is None else np.asarray(volumes, dtype=np.float64)
    if v.shape != own.shape:
        raise ValueError(f"volumes are of shape {v.shape}; give one for each of {len(own)} grains")
    total = np.zeros((len(own), d, d))
    with_walls = frame.wall_contacts
    for kind, ends in ((contacts, (contacts.i, contacts.j)), (with_walls, (with_walls.i,))):
        arms = np.einsum("ka,kb->kab", kind.normal[:, :d], kind.force[:, :d])
        for end in ends:
            # The arm to the contact and the force are both opposite on j.
            np.add.at(total, end, frame.radius[end, None, None] * arms)
    stress = (total + np.swapaxes(total, 1, 2)) / 2 / v[:, None, None]
    stress[frame.removed] = np.nan
    is_si = frame.units.get("radius") == "m"
    return xr.DataArray(
        stress,
        coords={
            "grain": grain_rows(frame),
            "axis": list("xyz"[:d]),
            "along": list("xyz"[:d]),
        },
        dims=("grain", "axis", "along"),
        name="stress",
        attrs=attributes("stress of grains", "Pa" if is_si else None),
    )


def grain_volumes(frame: Frame) -> Array:
    """Returns the volumes of grains, of disks their areas, [N] (m³; m²)."""
    r = frame.radius
    volumes: Array = np.pi * r**2 if frame.dimension == 2 else 4 / 3 * np.pi * r**3
    return volumes


def _magnitude(tangential: Array) -> Array:
    """Returns the lengths of tangential forces, of disks their magnitudes, [K]."""
    length: Array = (
        np.abs(tangential) if tangential.ndim == 1 else np.linalg.norm(tangential, axis=1)
    )
    return length
