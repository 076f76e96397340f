"""A matrix with the sparsity of K of a packing of spheres in 3D, as Matrix Market: K.mtx and the diagonal M.mtx.

    python packing_matrix.py GRAINS FOLDER [SEED]

Grains of two radii (1 and 1.4) at random in a periodic cube, pushed apart until they touch some six others each, six unknowns
per grain (displacement, rotation). Each contact adds, with u the displacement at the contact and B its dependence on the
unknowns of the two grains,

    Bᵀ (k_n n nᵀ + k_t (I - n nᵀ) - c t tᵀ + μ s k_n t nᵀ) B,

where the last, nonsymmetric term is a tangential force along t that follows the normal one (friction mobilised to the part s,
random), which also softens the tangential spring by c = s k_t / 2. M = diag(m, I) with I = 2/5 m R².
"""

import sys
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.io import mmwrite
from scipy.spatial import cKDTree

VOLUME_FRACTION = 0.66
NORMAL_STIFFNESS, TANGENTIAL_STIFFNESS, FRICTION = 1.0, 2.0 / 7.0, 0.5


def packing(grains, random):
    """Centres, radii and the side of a periodic cube in which soft spheres have pushed each other apart."""
    radius = np.where(np.arange(grains) % 2 == 0, 1.0, 1.4)
    side = (4.0 / 3.0 * np.pi * np.sum(radius**3) / VOLUME_FRACTION) ** (1.0 / 3.0)
    centre = random.uniform(0.0, side, (grains, 3))
    for _ in range(400):
        pairs, separation, distance = contacts(centre, radius, side)
        push = 0.3 * (radius[pairs].sum(axis=1) / distance - 1.0)[:, None] * separation
        np.add.at(centre, pairs[:, 0], push)
        np.add.at(centre, pairs[:, 1], -push)
        centre %= side
    return centre, radius, side


def contacts(centre, radius, side):
    """Pairs that overlap, r_i - r_j and |r_i - r_j|."""
    pairs = cKDTree(centre, boxsize=side).query_pairs(2.0 * radius.max(), output_type="ndarray")
    separation = centre[pairs[:, 0]] - centre[pairs[:, 1]]
    separation -= side * np.round(separation / side)
    distance = np.linalg.norm(separation, axis=1)
    touching = distance < radius[pairs].sum(axis=1)
    return pairs[touching], separation[touching], distance[touching]


def cross(n):
    """Matrices of n ×."""
    x, y, z = n.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


def stiffness(centre, radius, side, random):
    pairs, separation, distance = contacts(centre, radius, side)
    count = len(pairs)
    n = separation / distance[:, None]
    t = np.cross(n, random.normal(size=(count, 3)))
    t /= np.linalg.norm(t, axis=1)[:, None]
    mobilised = random.uniform(0.0, 1.0, count)[:, None, None] ** 8

    eye = np.eye(3)
    nn = n[:, :, None] * n[:, None, :]
    tt = t[:, :, None] * t[:, None, :]
    tn = t[:, :, None] * n[:, None, :]
    spring = NORMAL_STIFFNESS * nn + TANGENTIAL_STIFFNESS * (eye - nn) - 0.5 * TANGENTIAL_STIFFNESS * mobilised * tt
    spring = spring + FRICTION * NORMAL_STIFFNESS * mobilised * tn

    # u = dr_i - dr_j + n × (R_i dθ_i + R_j dθ_j)
    twist = cross(n)
    unit = np.broadcast_to(eye, (count, 3, 3))
    lever = radius[pairs][:, :, None, None]
    b = np.concatenate([unit, lever[:, 0] * twist, -unit, lever[:, 1] * twist], axis=2)
    block = np.einsum("cki,ckl,clj->cij", b, spring, b)

    unknown = (6 * pairs[:, :, None] + np.arange(6)).reshape(count, 12)
    rows = np.broadcast_to(unknown[:, :, None], block.shape)
    columns = np.broadcast_to(unknown[:, None, :], block.shape)
    size = 6 * len(centre)
    k = sp.coo_matrix((block.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)).tocsc()
    return k, 2.0 * count / len(centre)


def masses(radius):
    """diag(m, I), m = R³."""
    m = np.repeat(radius[:, None] ** 3, 6, axis=1)
    m[:, 3:] *= 0.4 * radius[:, None] ** 2
    return m.ravel()


def main():
    grains, folder = int(sys.argv[1]), Path(sys.argv[2])
    random = np.random.default_rng(int(sys.argv[3]) if len(sys.argv) > 3 else 1)
    centre, radius, side = packing(grains, random)
    k, coordination = stiffness(centre, radius, side, random)
    folder.mkdir(parents=True, exist_ok=True)
    mmwrite(folder / "K.mtx", k, precision=17)
    mmwrite(folder / "M.mtx", sp.diags(masses(radius)).tocoo(), precision=17)
    print(f"{6 * grains} unknowns, {coordination:.2f} contacts per grain, {k.nnz} entries")


if __name__ == "__main__":
    main()
