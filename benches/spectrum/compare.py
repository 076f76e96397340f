"""`gshear-reduce spectrum` beside SciPy's ARPACK (eigs with sigma), the same matrix and shift, runs in turn on one core.

    python compare.py GSHEAR_REDUCE FOLDER SHIFT COUNT REPETITIONS [COLAMD|MMD_AT_PLUS_A]

FOLDER holds K.mtx and M.mtx (packing_matrix.py). Ours is the time of the whole program, files read and written; SciPy's that of `eigs` alone,
with the LU of SuperLU under the given column ordering (COLAMD is what eigs itself takes).
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

PEER = """
import sys, time, json, resource
import numpy as np, scipy.sparse as sp, scipy.sparse.linalg as sla
from scipy.io import mmread
folder, shift, count, ordering, out = sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), sys.argv[4], sys.argv[5]
k = mmread(folder + "/K.mtx").tocsc()
d = sp.diags(1.0 / np.sqrt(mmread(folder + "/M.mtx").tocsc().diagonal()))
a = (d @ k @ d).tocsc()
begin = time.perf_counter()
lu = sla.splu((a - shift * sp.identity(a.shape[0])).tocsc(), permc_spec=ordering)
factored = time.perf_counter() - begin
inverse = sla.LinearOperator(a.shape, matvec=lu.solve, dtype=float)
values, vectors = sla.eigs(a, k=count, sigma=shift, OPinv=inverse, tol=1e-13)
seconds = time.perf_counter() - begin
residual = np.linalg.norm(a @ vectors - vectors * values, axis=0).max()
np.save(out, values)
print(json.dumps(dict(seconds=seconds, factored=factored, fill=int(lu.L.nnz + lu.U.nnz), residual=float(residual))))
"""


def run(command):
    """Seconds, greatest resident memory (MB) and standard output of a program on the first core."""
    begin = time.perf_counter()
    process = subprocess.Popen(["taskset", "-c", "0", *command], stdout=subprocess.PIPE, text=True)
    text = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    assert status == 0, text
    return time.perf_counter() - begin, usage.ru_maxrss / 1024.0, text


def main():
    program, folder, shift, count, repetitions = sys.argv[1:6]
    ordering = sys.argv[6] if len(sys.argv) > 6 else "COLAMD"
    ours, peers = [], []
    with tempfile.TemporaryDirectory() as out:
        ask = [program, "spectrum", "--threads", "1", "--matrix", f"{folder}/K.mtx", "--mass", f"{folder}/M.mtx"]
        ask += ["--shift", shift, "--count", count, "--group", "6", "--right-only", "--out", out]
        for _ in range(int(repetitions)):
            ours.append(run(ask))
            peers.append(run([sys.executable, "-c", PEER, folder, shift, count, ordering, f"{out}/values.npy"]))
        rows = [line.split(",") for line in Path(out, "spectrum.csv").read_text().splitlines()[1:]]
        values = np.array([complex(float(row[0]), float(row[1])) for row in rows])
        theirs = np.load(f"{out}/values.npy")
    apart = max(np.abs(values - value).min() for value in theirs)
    peer = [json.loads(text) for _, _, text in peers]
    seconds = np.median([one["seconds"] for one in peer])
    mine = np.median([one[0] for one in ours])
    print(f"ours {mine:.2f} s, {max(one[1] for one in ours):.0f} MB")
    print(f"SciPy {ordering} {seconds:.2f} s (LU {np.median([one['factored'] for one in peer]):.2f} s), {max(one[1] for one in peers):.0f} MB, "
          f"fill {peer[0]['fill'] / 1e6:.1f} M, residual {peer[0]['residual']:.1e}")
    print(f"ratio {seconds / mine:.1f}; eigenvalues agree to {apart:.1e}")
    print(ours[-1][2])


if __name__ == "__main__":
    main()
