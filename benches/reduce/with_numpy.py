"""The scalars of a frame (docs/explanation/reduction.md) as a good user of NumPy and SciPy would
compute them: no loop over grains."""
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.stats import spearmanr


class Grains:
    def __init__(self, file):
        particles = file["particles/trajectory"]
        self.length = particles["box/edges"][0]
        self.radius = particles["radius"][:]
        self.body = particles["body"][:]
        self.count = len(self.radius)
        self.mean_radius = self.radius.mean()


def frames(file, first, end):
    """Frames of a range: positions and, of the contacts, ids and forces. Everything of the range is read at once."""
    contacts = file["connectivity/contacts"]
    offset = contacts["offset"][first:end + 1]
    rows = slice(offset[0], offset[-1])
    columns = [contacts[name][rows] for name in ("i", "j", "normal_force", "tangential_force")]
    position = file["particles/trajectory/position/value"][first:end, :, :2]
    for k, start in enumerate(offset[:-1]):
        part = slice(start - offset[0], offset[k + 1] - offset[0])
        yield (position[k], *(column[part] for column in columns))


def separation(length, d):
    d[:, 0] -= length * np.round(d[:, 0] / length)
    return d


def summed(index, weights, count):
    return np.bincount(index, weights=weights, minlength=count)


def dmin(grains, earlier, later):
    """[N], NaN for rattlers and where it is undefined."""
    n, (i, j) = grains.count, earlier[1:3]
    rattler = np.bincount(i, minlength=n) + np.bincount(j, minlength=n) <= np.where(grains.body == 0, 2, 1)
    kept = np.flatnonzero(~rattler)
    # A box of length 0 is not periodic.
    tree = cKDTree(earlier[0][kept], boxsize=[grains.length, 0.0])
    pairs = kept[tree.query_pairs(5.0 * grains.mean_radius, output_type="ndarray")]
    a, b = pairs[:, 0], pairs[:, 1]
    before = separation(grains.length, earlier[0][b] - earlier[0][a])
    after = separation(grains.length, later[0][b] - later[0][a])
    ends = np.concatenate([a, b])

    def moment(u, v):
        return summed(ends, np.tile(u * v, 2), n)

    x = np.array([[moment(after[:, k], before[:, l]) for l in (0, 1)] for k in (0, 1)])
    xx, xy, yy = (moment(before[:, k], before[:, l]) for k, l in ((0, 0), (0, 1), (1, 1)))
    neighbours = np.bincount(ends, minlength=n)
    with np.errstate(invalid="ignore", divide="ignore"):
        determinant = xx * yy - xy * xy
        determinant[~(determinant > 1e-12 * (xx + yy) ** 2)] = np.nan
        inverse = np.array([[yy, -xy], [-xy, xx]]) / determinant
        gamma = np.einsum("kln,lmn->kmn", x, inverse)
        total = np.zeros(n)
        for end in (a, b):
            rest = after - np.einsum("kln,nl->nk", gamma[:, :, end], before)
            total += summed(end, (rest * rest).sum(axis=1), n)
        return total / neighbours


def forces(grains, frame):
    """n from j to i, and f on i."""
    position, i, j, normal, tangential = frame
    d = separation(grains.length, position[i] - position[j])
    n = d / np.hypot(d[:, 0], d[:, 1])[:, None]
    return n, normal[:, None] * n + tangential[:, None] * np.column_stack([-n[:, 1], n[:, 0]])


def principal(grains, frame):
    n, f = forces(grains, frame)
    i, j = frame[1:3]
    scale = 1.0 / (np.pi * grains.radius)

    def stress(moment):
        return scale * (summed(i, moment, grains.count) + summed(j, moment, grains.count))

    xx, yy = stress(n[:, 0] * f[:, 0]), stress(n[:, 1] * f[:, 1])
    xy = stress(0.5 * (n[:, 0] * f[:, 1] + n[:, 1] * f[:, 0]))
    return 0.5 * (xx + yy) + np.sqrt((0.5 * (xx - yy)) ** 2 + xy * xy)


def regions(grains, earlier, later):
    """The grains of the greatest reduction, and the numbers of their clusters with minPts = 1 and 2."""
    n = grains.count
    keys = [frame[1].astype(np.int64) * n + frame[2] for frame in (earlier, later)]
    sizes = [np.hypot(frame[3], frame[4]) for frame in (earlier, later)]
    _, old, new = np.intersect1d(*keys, assume_unique=True, return_indices=True)
    change = sizes[1][new] - sizes[0][old]
    reduction = summed(later[1][new], change, n) + summed(later[2][new], change, n)
    wanted = max(int(0.01 * n + 0.5), 1)
    chosen = np.argpartition(reduction, wanted)[:wanted]
    chosen = chosen[reduction[chosen] < 0.0]
    tree = cKDTree(later[0][chosen], boxsize=[grains.length, 0.0])
    pairs = tree.query_pairs(5.0 * grains.mean_radius, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(chosen),) * 2)
    count, labels = connected_components(graph, directed=False)
    # With minPts = 2 whoever has a neighbour is a core point.
    return chosen, count, int((np.bincount(labels) > 1).sum())


def scalars(grains, earlier, later):
    """In the order of the columns of regions.csv."""
    d = dmin(grains, earlier, later)
    defined = ~np.isnan(d)
    change = np.abs(principal(grains, later) - principal(grains, earlier))
    rho = spearmanr(change[defined], d[defined])
    chosen, count, count_of_two = regions(grains, earlier, later)
    within = np.zeros(grains.count, dtype=bool)
    within[chosen] = True
    _, f = forces(grains, later)
    f = np.abs(f[within[later[1]] | within[later[2]]])
    angles = np.arctan2(f[:, 1], f[:, 0])
    values = d[defined]
    top = max(int(0.1 * len(values) + 0.5), 1)
    return (values.max(), np.partition(values, -top)[-top:].mean(), count, count_of_two,
            rho.statistic, rho.pvalue, angles.mean(), np.median(angles))
