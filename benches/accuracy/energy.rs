//! The balance of energy of a sheared sample: what the walls do, what is stored, what is
//! dissipated.

use gshear_dem::contact::ContactLaw;
use gshear_dem::contact::stiffness::Stiffness;
use gshear_dem::dimension::{Dimension, Two};
use gshear_dem::laws::lee_hurley::normal_stiffness;
use gshear_dem::state::body;

use crate::sample::{Moving, Sample};
use crate::scheme::Dampers;

/// What the sum of work, storage and loss leaves over the span (s) in `steps` steps, over the work
/// that went through the walls. `None` where the run failed. The law is without rolling torques,
/// which are not sampled.
///
/// ΔK + ΔU_n = ∫ Σ [(F_n - k_n δ) v_n + F_t v_t] dt - ∫ F·v of the wall grains dt: U_n is the work
/// of k_n δ in closed form, the integrals are sums by trapezoids of what the steps end with.
pub fn imbalance<C: ContactLaw<Space = Two> + Stiffness>(
    sample: &Sample,
    law: C,
    span: f64,
    steps: usize,
    dampers: Dampers,
) -> Option<f64> {
    assert!(!C::ROLLING);
    let step = span / steps as f64;
    let mut moving = sample.start(law, step, dampers);
    let modulus = sample.material().effective_modulus();
    let first = state(&mut moving, modulus);
    let mut last = first;
    let (mut received, mut through) = (0.0, 0.0);
    for _ in 0..steps {
        moving.one(true)?;
        let now = state(&mut moving, modulus);
        received += 0.5 * step * (last.power + now.power);
        through += 0.5 * step * (last.wall.abs() + now.wall.abs());
        last = now;
    }
    Some((last.energy - first.energy - received).abs() / through)
}

/// The free grains' kinetic energy and U_n (J/m); the power of all but the elastic normal forces on
/// them, and of the walls alone (W/m).
#[derive(Debug, Clone, Copy)]
struct State {
    energy: f64,
    power: f64,
    wall: f64,
}

const U: usize = Two::VELOCITY;
const V: usize = Two::VELOCITY + Two::UP;
const W: usize = Two::SPIN;

fn state<C: ContactLaw<Space = Two> + Stiffness>(moving: &mut Moving<C>, modulus: f64) -> State {
    let cell = moving.system.cell;
    let (mut energy, mut wall) = (0.0, 0.0);
    let states = moving.system.grain_states();
    let (grains, contacts) = moving.system.grains_and_contacts();
    for (g, state) in states.iter().enumerate() {
        let ([u, v, _], [fx, fy, _]) = (state.velocity, state.force);
        if state.body == body::FREE {
            let (m, r, w) = (grains.mass[g], state.radius, state.angular_velocity[2]);
            energy += 0.5 * m * (u * u + v * v + 0.5 * r * r * w * w);
        } else {
            wall -= fx * u + fy * v;
        }
    }
    let mut dissipated = 0.0;
    for at in contacts.touching() {
        let [a, b] = [at.i, at.j].map(|g| grains.fields(g));
        let (r_a, r_b) = (grains.radius[at.i], grains.radius[at.j]);
        let [dx, dy, _] = cell.separation::<Two>(a, b);
        let distance = dx.hypot(dy);
        let (n_x, n_y) = (dx / distance, dy / distance);
        let (du, dv) = (a[U] - b[U], a[V] - b[V]);
        let v_n = du * n_x + dv * n_y;
        let v_t = dv * n_x - du * n_y - r_a * a[W] - r_b * b[W];
        let overlap = r_a + r_b - distance;
        let k_n = normal_stiffness(modulus, r_a, r_b, overlap);
        let normal = moving.samples.normal[at.block].0[at.lane];
        let tangential = moving.samples.tangential[at.block][0].0[at.lane];
        dissipated += (normal - k_n * overlap) * v_n + tangential * v_t;
        energy += stored(modulus, r_a + r_b, k_n, overlap);
    }
    State {
        energy,
        power: dissipated + wall,
        wall,
    }
}

/// ∫ k_n δ dδ = 8πE* (R_1+R_2)² x² (ℓ - 3/2): of F = 4πE* (R_1+R_2) x, δ = 4 (R_1+R_2) x (ℓ-1), ℓ =
/// -ln x.
fn stored(modulus: f64, sum: f64, k_n: f64, overlap: f64) -> f64 {
    let full = std::f64::consts::PI * modulus;
    let ell = 1.0 + full / k_n;
    let x = k_n * overlap / (4.0 * full * sum);
    8.0 * full * sum * sum * x * x * (ell - 1.5)
}
