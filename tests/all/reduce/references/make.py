"""Values of other programs that tests/all/reduce/references.rs compares with.

    pip install numpy scipy scikit-learn ovito && python make.py

Made with SciPy 1.17.1 (Spearman), scikit-learn 1.9.1 (DBSCAN) and OVITO 3.17.2 (D²min). Inputs are made of the integers of
splitmix64, here and in the test alike, so that only results are stored.
"""
import json
import pathlib

import numpy as np

HERE = pathlib.Path(__file__).parent
MASK = (1 << 64) - 1


def uniform(seed, count):
    """count numbers of [0, 1): the upper 53 bits of splitmix64 from `seed` on."""
    values, state = [], seed
    for _ in range(count):
        state = (state + 0x9E3779B97F4A7C15) & MASK
        z = state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
        values.append(((z ^ (z >> 31)) >> 11) * 2.0**-53)
    return np.array(values)


def number(value):
    """JSON has no NaN."""
    return None if np.isnan(value) else float(value)


def spearman():
    from scipy.stats import rankdata, spearmanr

    cases = []
    # pairs, weight of the first in the second, levels of the values (0: no ties)
    for seed, (count, weight, levels) in enumerate(
        [(3, 0.5, 0), (4, 0.0, 2), (5, 0.9, 0), (10, 0.2, 0), (12, 0.3, 4), (30, -0.4, 0), (50, 0.01, 7), (79, 0.5, 3),
         (83, 0.1, 0), (100, 0.6, 0), (250, 0.95, 0), (500, 0.05, 20), (1000, 0.3, 0), (1000, 0.5, 0), (2000, -0.03, 0),
         (5000, 0.02, 50), (20000, 0.01, 0), (130000, 0.003, 0), (130000, 0.002, 300), (40, 1.0, 0), (40, -1.0, 0)]):
        x, noise = uniform(2 * seed, count), uniform(2 * seed + 1, count)
        y = weight * x + (1.0 - abs(weight)) * noise
        if levels:
            x, y = np.floor(x * levels), np.floor(y * levels)
        found = spearmanr(x, y)
        case = dict(seed=seed, count=count, weight=weight, levels=levels, rho=number(found.statistic), p=number(found.pvalue))
        if count <= 12:
            case["ranks"] = [list(rankdata(x)), list(rankdata(y))]
        cases.append(case)
    return cases


def dbscan():
    from sklearn.cluster import DBSCAN

    cases = []
    for seed in range(50):
        count = 10 + 7 * (seed % 11)
        points = uniform(1000 + seed, 2 * count).reshape(count, 2)
        reach = 0.05 + 0.01 * (seed % 13)
        least = 1 + seed % 5
        d = points[:, None, :] - points[None, :, :]
        d[..., 0] -= np.round(d[..., 0])
        labels = DBSCAN(eps=reach, min_samples=least, metric="precomputed").fit(np.hypot(d[..., 0], d[..., 1])).labels_
        cases.append(dict(seed=1000 + seed, count=count, reach=reach, min_points=least, labels=labels.tolist()))
    return cases


def dmin():
    from ovito.data import DataCollection, Particles, SimulationCell
    from ovito.modifiers import AtomicStrainModifier
    from ovito.pipeline import Pipeline, StaticSource

    def collection(position, side):
        data = DataCollection()
        cell = SimulationCell(pbc=(True, False, False), is2D=True)
        cell[...] = [[side, 0, 0, 0], [0, side, 0, 0], [0, 0, 1, -0.5]]
        data.objects.append(cell)
        particles = Particles()
        particles.create_property("Position", data=np.column_stack([position, np.zeros(len(position))]))
        particles.create_property("Particle Identifier", data=np.arange(len(position)) + 1)
        data.objects.append(particles)
        return data

    cases = []
    # Moves of no less than 1e-3 R: OVITO works in reduced coordinates, whose rounding reaches D²min of smaller ones.
    for seed, (count, side, moved) in enumerate([(60, 20.0, 0.3), (150, 26.0, 1e-3), (300, 40.0, 1e-2)]):
        x, y, dx, dy = uniform(5000 + seed, 4 * count).reshape(4, count)
        earlier = np.column_stack([x * side, y * side])
        later = np.column_stack([(earlier[:, 0] + 0.01 * earlier[:, 1] + moved * (dx - 0.5)) % side,
                                 earlier[:, 1] + moved * (dy - 0.5)])
        modifier = AtomicStrainModifier(cutoff=5.0, output_nonaffine_squared_displacements=True,
                                        minimum_image_convention=True,
                                        affine_mapping=AtomicStrainModifier.AffineMapping.Off)
        modifier.reference = StaticSource(data=collection(earlier, side))
        pipeline = Pipeline(source=StaticSource(data=collection(later, side)))
        pipeline.modifiers.append(modifier)
        sums = pipeline.compute().particles["Nonaffine Squared Displacement"][...]
        d = earlier[:, None, :] - earlier[None, :, :]
        d[..., 0] -= side * np.round(d[..., 0] / side)
        neighbours = (np.hypot(d[..., 0], d[..., 1]) <= 5.0).sum(axis=1) - 1
        cases.append(dict(seed=5000 + seed, count=count, side=side, moved=moved, dmin=(sums / neighbours).tolist()))
    return cases


for make in (spearman, dbscan, dmin):
    rows = ",\n".join(json.dumps(case) for case in make())
    (HERE / f"{make.__name__}.json").write_text(f"[\n{rows}\n]\n")
