//! The state of a run as records that are sent between ranks, written to checkpoints and hashed for
//! the digest.

use bytemuck::{Pod, Zeroable};

use super::{ContactSample, GrainSample, Image, body};
use crate::contact::{History, TORQUES};

/// The state of a grain, SI units; in two dimensions the unused components are 0.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GrainState {
    /// Id.
    pub id: u32,
    /// 0 free, 1 bottom wall, 2 top wall, 3 removed.
    pub body: u32,
    /// Wrapped position (m).
    pub position: [f64; 3],
    /// Velocity (m/s).
    pub velocity: [f64; 3],
    /// Angular velocity (rad/s).
    pub angular_velocity: [f64; 3],
    /// R (m).
    pub radius: f64,
    /// Force of the last step (N; N/m in 2D).
    pub force: [f64; 3],
    /// Torque of the last step (N m; N in 2D).
    pub torque: [f64; 3],
    /// Image in which it is: the position plus these multiples of the edges of the box moves
    /// without jumps.
    pub image: Image,
    /// Number of its material.
    pub material: u64,
}

impl GrainState {
    /// The bytes of all that the motion depends on: of every field before the image.
    pub fn moving(&self) -> &[u8] {
        &bytemuck::bytes_of(self)[..std::mem::offset_of!(Self, image)]
    }
}

/// The state of a touching contact, `i < j`.
///
/// The history in 2D: the law's elastic force (N/m) or displacement (m) along t̂, the last k_t
/// (Pa), the elastic rolling torque (N). In 3D: the vector of its tangential force (N) or
/// displacement (m).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ContactState {
    /// Lower id.
    pub i: u32,
    /// Higher id.
    pub j: u32,
    /// History; see above.
    pub history: [f64; 3],
    /// [`ContactState::limits`], as [`ContactState::stored`] writes them.
    pub limits: i64,
    /// Elastic torques on i that resist the rolling and twisting of spheres: a vector in the
    /// tangent plane and the component along n (N m).
    pub torques: [f64; 4],
    /// Age (s), where friction grows with it.
    pub age: f64,
}

/// The bits of [`ContactState::limits`] of friction, rolling and twisting: at the limit, and known.
const LIMITS: [[i64; 2]; 3] = [[1, 4], [2, 8], [32, 64]];

impl ContactState {
    /// A contact with this history; what limits it is at is not known.
    pub fn new(i: u32, j: u32, history: [f64; 3]) -> Self {
        Self {
            i,
            j,
            history,
            limits: 0,
            torques: [0.0; TORQUES],
            age: 0.0,
        }
    }

    /// History, torques and age.
    pub fn all_histories(&self) -> History {
        let ([a, b, c], [d, e, f, g]) = (self.history, self.torques);
        [a, b, c, d, e, f, g, self.age]
    }

    /// The same with these.
    #[must_use]
    pub fn with_histories(self, [a, b, c, d, e, f, g, age]: History) -> Self {
        Self {
            history: [a, b, c],
            torques: [d, e, f, g],
            age,
            ..self
        }
    }

    /// Whether it was at the limit of friction, at that of rolling and at that of twisting, when
    /// the forces were last computed; `None` if that is not known, because that was no step, or it
    /// was not stored.
    pub fn limits(&self) -> [Option<bool>; 3] {
        let is_set = |bit: i64| self.limits & bit != 0;
        LIMITS.map(|[limit, known]| is_set(known).then(|| is_set(limit)))
    }

    /// Whether it transmitted nothing when the forces were last computed: its damper would have
    /// made F_n negative.
    pub fn is_idle(&self) -> bool {
        self.limits & 16 != 0
    }

    /// Limits as a number: 1, 2 and 32 where it is at that of friction, rolling and twisting, 4, 8
    /// and 64 where that is known, and 16 if it is idle.
    pub fn stored(limits: [Option<bool>; 3], is_idle: bool) -> i64 {
        let mut number = 16 * i64::from(is_idle);
        for (limit, [bit, known]) in limits.into_iter().zip(LIMITS) {
            if let Some(is_at) = limit {
                number += known + bit * i64::from(is_at);
            }
        }
        number
    }

    /// The bytes of all that the motion of disks depends on, of every field before the limits.
    pub fn moving(&self) -> &[u8] {
        &bytemuck::bytes_of(self)[..std::mem::offset_of!(Self, limits)]
    }

    /// What the motion of spheres depends on beside that but for the age: at which limits it is,
    /// and the torques.
    pub(crate) fn moving_spheres(&self) -> (i64, [f64; TORQUES]) {
        let [[slides, _], [rolls, _], _] = LIMITS;
        (self.limits & (slides | rolls), self.torques)
    }
}

impl From<&GrainState> for GrainSample {
    fn from(grain: &GrainState) -> Self {
        Self {
            id: grain.id,
            removed: (grain.body == body::REMOVED).into(),
            position: grain.position,
            velocity: grain.velocity,
            angular_velocity: grain.angular_velocity,
            image: grain.image,
        }
    }
}

/// The position of a disk in a frame, for the scalars of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GrainPosition {
    /// Id.
    pub id: u32,
    /// 0; the scalars do not use it.
    pub body: u32,
    /// Wrapped position (m).
    pub position: [f64; 2],
    /// Image along x in which it is.
    pub image: i64,
}

impl From<&GrainSample> for GrainPosition {
    fn from(grain: &GrainSample) -> Self {
        Self {
            id: grain.id,
            body: 0,
            position: [grain.position[0], grain.position[1]],
            image: grain.image[0],
        }
    }
}

/// The forces of a contact in a frame, `i < j`, for the scalars of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ContactForce {
    /// Lower id.
    pub i: u32,
    /// Higher id.
    pub j: u32,
    /// F_n (N/m).
    pub normal_force: f64,
    /// F_t along t̂ (N/m).
    pub tangential_force: f64,
}

impl From<&ContactSample> for ContactForce {
    fn from(contact: &ContactSample) -> Self {
        Self {
            i: contact.i,
            j: contact.j,
            normal_force: contact.normal_force,
            tangential_force: contact.tangential_force[0],
        }
    }
}

/// This rank's part of a frame whose scalars are computed. Over all ranks, every grain and every
/// contact occurs once.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FramePart {
    /// Owned grains.
    pub grains: Vec<GrainPosition>,
    /// Contacts whose first grain this rank owns.
    pub contacts: Vec<ContactForce>,
}

/// The displacement of a grain since the start of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Displacement {
    /// Id.
    pub id: u32,
    /// Body, as in [`GrainState`].
    pub body: u32,
    /// Its position at the start (m), wrapped.
    pub start: [f64; 3],
    /// Its rotation since (rad), summed over the steps.
    pub angle: [f64; 3],
    /// Its image at the start.
    pub image: Image,
}

impl From<&GrainState> for Displacement {
    /// No displacement, from this state on.
    fn from(grain: &GrainState) -> Self {
        Self {
            id: grain.id,
            body: grain.body,
            start: grain.position,
            angle: [0.0; 3],
            image: grain.image,
        }
    }
}

/// This rank's part of a state to which a run may return.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct HeldState {
    /// Owned grains.
    pub grains: Vec<GrainState>,
    /// Contacts of owned grains.
    pub contacts: Vec<ContactState>,
}

/// This rank's part of the state of a stage.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Snapshot {
    /// Grains; each on one rank, whichever.
    pub grains: Vec<GrainState>,
    /// Contacts: in a checkpoint on the rank that has their first grain, where a stage begins on
    /// the ranks of both grains.
    pub contacts: Vec<ContactState>,
    /// The last frame whose scalars the run computed, from which the next interval starts; on all
    /// ranks or on none.
    pub analysed: Option<FramePart>,
    /// The displacements of a stage that measures them; on all ranks or on none.
    pub displacements: Option<Vec<Displacement>>,
    /// States to which the run may return; as many on every rank.
    pub held: Vec<HeldState>,
}
