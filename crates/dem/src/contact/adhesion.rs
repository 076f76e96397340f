//! The interface of adhesions: what holds two grains together beside the law of their contact. The
//! adhesions are in [`crate::adhesions`].
//!
//! An [`Adhesion`] answers a few questions about pairs. The kernel asks them through
//! [`AdhesionModel`], which every adhesion has, with one virtual call for some blocks of contacts,
//! and knows no adhesion by name.
//!
//! Every contact begins at δ = 0. Where and with which forces it ends is one of the questions.

use std::any::Any;
use std::fmt::Debug;

use super::{PairRadii, scalar};
use crate::simd::{Isa, Lanes, Lanes16, Mask, Portable, PortableToken, Work};

/// Sixteen pairs of grains, as an adhesion sees them.
#[derive(Debug, Clone, Copy)]
pub struct AdhesivePairs<L> {
    /// Their radii (m).
    pub radii: PairRadii<L>,
    /// δ (m); negative across a gap.
    pub overlap: L,
    /// The overlap that the law is given (m): [`Adhesion::elastic_overlap`].
    pub elastic_overlap: L,
}

/// The adhesion of two grains, as K sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdhesiveContact {
    /// The overlap that the law is given (m).
    pub elastic_overlap: f64,
    /// Its derivative by δ.
    pub elastic_slope: f64,
    /// The attraction (N; N/m in 2D).
    pub force: f64,
    /// Its derivative by δ (N/m; Pa in 2D).
    pub force_slope: f64,
}

/// An adhesion of two grains: F_n = F_n' - F_c, with F_n' ≥ 0 of the law and F_c of the adhesion.
///
/// Friction, rolling and twisting are limited by F_n', with which the grains press on each other.
/// Functions of lanes are `#[inline(always)]`, and compute with the operations of [`Lanes`] alone,
/// so that every instruction set gives the same bits. Where pairs are not in contact their answers
/// are arbitrary.
pub trait Adhesion: Copy + Debug + PartialEq + Send + Sync + 'static {
    /// Whether it also acts across a gap: contacts end where [`Adhesion::margin`] does.
    const ACROSS_GAPS: bool = false;
    /// Whether it changes the area of contact. The law is then given
    /// [`Adhesion::elastic_overlap`], and all forces of a contact begin and end with the adhesion.
    const CHANGES_AREA: bool = false;

    /// F_c (N; N/m in 2D) of pairs in contact.
    fn force<L: Lanes>(&self, token: L::Token, pairs: &AdhesivePairs<L>) -> L;

    /// How much further (m) pairs at the overlap δ (m) may move apart before their contact ends:
    /// δ + s where it ends at a gap s.
    #[inline(always)]
    fn margin<L: Lanes>(&self, _: L::Token, _radii: &PairRadii<L>, overlap: L) -> L {
        overlap
    }

    /// The overlap (m) at which a contact without adhesion has the same area, at the overlap δ (m).
    #[inline(always)]
    fn elastic_overlap<L: Lanes>(&self, _: L::Token, _radii: &PairRadii<L>, overlap: L) -> L {
        overlap
    }

    /// `energy` (J; J/m in 2D) and the potential of F_c, which is 0 where contacts begin; with
    /// [`Adhesion::CHANGES_AREA`] the potential of F_n without that of F_n' at
    /// [`AdhesivePairs::elastic_overlap`].
    fn add_potential<L: Lanes>(&self, token: L::Token, pairs: &AdhesivePairs<L>, energy: L) -> L;

    /// The contact of grains of radii r1, r2 (m) at the overlap δ (m), for K. As it is here for
    /// forces that do not depend on δ; others set the derivatives.
    fn contact(&self, radii: [f64; 2], overlap: f64) -> AdhesiveContact {
        without_slopes(self, radii, overlap)
    }

    /// The force (N; N/m in 2D) that separates two grains of radii r1, r2 (m): the greatest F_c of
    /// a contact without a load. As it is here if that is F_c at δ = 0.
    fn pull_off(&self, radii: [f64; 2]) -> f64 {
        without_slopes(self, radii, 0.0).force
    }

    /// F_c (N; N/m in 2D) of two grains of radii r1, r2 (m) that a load (N; N/m in 2D) presses
    /// together. As it is here if F_c does not depend on the load.
    fn under_load(&self, _load: f64, radii: [f64; 2]) -> f64 {
        self.pull_off(radii)
    }
}

/// Overlap and force of an adhesion between grains of radii r1, r2 (m) at the overlap δ (m), as its
/// functions of lanes give them, with the derivatives of a constant force.
pub fn without_slopes<A: Adhesion>(adhesion: &A, radii: [f64; 2], overlap: f64) -> AdhesiveContact {
    let elastic_overlap = scalar(|token| {
        let overlap = Portable::splat(token, overlap);
        adhesion.elastic_overlap(token, &portable_radii(radii), overlap)
    });
    let force = scalar(|token| {
        let pairs = AdhesivePairs {
            radii: portable_radii(radii),
            overlap: Portable::splat(token, overlap),
            elastic_overlap: Portable::splat(token, elastic_overlap),
        };
        adhesion.force(token, &pairs)
    });
    AdhesiveContact {
        elastic_overlap,
        elastic_slope: 1.0,
        force,
        force_slope: 0.0,
    }
}

/// Radii of one pair (m) in every lane.
fn portable_radii(radii: [f64; 2]) -> PairRadii<Portable> {
    PairRadii {
        sum: Portable::splat(PortableToken, radii[0] + radii[1]),
        first: Portable::splat(PortableToken, radii[0]),
    }
}

/// R* (m) of two radii (m).
pub fn reduced_radius(radii: [f64; 2]) -> f64 {
    radii[0] * radii[1] / (radii[0] + radii[1])
}

/// Blocks of sixteen pairs.
#[derive(Debug, Clone, Copy)]
pub struct AdhesiveBlocks<'a> {
    /// R_i + R_j and R_i (m).
    pub geometry: &'a [[Lanes16; 2]],
    /// δ (m).
    pub overlap: &'a [Lanes16],
    /// The overlap that the law is given (m); only [`Question::Force`] and
    /// [`Question::Potential`] need it.
    pub elastic_overlap: &'a [Lanes16],
}

/// Blocks of sixteen pairs before it is known which of them are in contact.
#[derive(Debug, Clone, Copy)]
pub struct UnheldBlocks<'a> {
    /// R_i + R_j and R_i (m).
    pub geometry: &'a [[Lanes16; 2]],
    /// Pairs that were in contact a step ago.
    pub touching: &'a [u16],
    /// δ (m).
    pub overlap: &'a [Lanes16],
    /// δ a step ago (m), if it matters.
    pub last_overlap: Option<&'a [Lanes16]>,
}

/// What an adhesion says of sixteen pairs, if one of them overlaps or was in contact a step ago.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub struct HeldBlock {
    /// [`Adhesion::margin`] (m).
    pub margin: Lanes16,
    /// [`Adhesion::elastic_overlap`] (m).
    pub elastic_overlap: Lanes16,
    /// The same a step ago (m), if it was asked.
    pub last_elastic_overlap: Lanes16,
}

/// What is asked of an adhesion about blocks of pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Question {
    /// [`Adhesion::elastic_overlap`].
    ElasticOverlap,
    /// [`Adhesion::force`].
    Force,
    /// [`Adhesion::add_potential`]; the answer is added to what is there.
    Potential,
}

/// An adhesion outside its own file: chosen at run time, with one virtual call for many contacts.
/// Every [`Adhesion`] is one.
pub trait AdhesionModel: Any + Debug + Send + Sync {
    /// [`Adhesion::ACROSS_GAPS`].
    fn acts_across_gaps(&self) -> bool;

    /// [`Adhesion::CHANGES_AREA`].
    fn changes_area(&self) -> bool;

    /// Says where some blocks of pairs are between touch and separation.
    fn hold(&self, isa: Isa, blocks: &UnheldBlocks<'_>, held: &mut [HeldBlock]);

    /// Answers a question about some blocks.
    fn answer(
        &self,
        isa: Isa,
        question: Question,
        blocks: &AdhesiveBlocks<'_>,
        answers: &mut [Lanes16],
    );

    /// [`Adhesion::contact`].
    fn contact(&self, radii: [f64; 2], overlap: f64) -> AdhesiveContact;

    /// The gap (m) at which the contact of grains of radii r1, r2 (m) ends.
    fn gap(&self, radii: [f64; 2]) -> f64;

    /// [`Adhesion::pull_off`].
    fn pull_off(&self, radii: [f64; 2]) -> f64;

    /// [`Adhesion::under_load`].
    fn under_load(&self, load: f64, radii: [f64; 2]) -> f64;

    /// Whether the other is the same adhesion with the same constants.
    fn is_equal(&self, other: &dyn AdhesionModel) -> bool;
}

impl PartialEq for dyn AdhesionModel {
    fn eq(&self, other: &Self) -> bool {
        self.is_equal(other)
    }
}

impl<A: Adhesion> AdhesionModel for A {
    fn acts_across_gaps(&self) -> bool {
        A::ACROSS_GAPS
    }

    fn changes_area(&self) -> bool {
        A::CHANGES_AREA
    }

    fn hold(&self, isa: Isa, blocks: &UnheldBlocks<'_>, held: &mut [HeldBlock]) {
        isa.run(Holding {
            adhesion: self,
            blocks,
            held,
        });
    }

    fn answer(
        &self,
        isa: Isa,
        question: Question,
        blocks: &AdhesiveBlocks<'_>,
        answers: &mut [Lanes16],
    ) {
        isa.run(Answers {
            adhesion: self,
            question,
            blocks,
            out: answers,
        });
    }

    fn contact(&self, radii: [f64; 2], overlap: f64) -> AdhesiveContact {
        Adhesion::contact(self, radii, overlap)
    }

    fn gap(&self, radii: [f64; 2]) -> f64 {
        scalar(|token| self.margin(token, &portable_radii(radii), Portable::splat(token, 0.0)))
    }

    fn pull_off(&self, radii: [f64; 2]) -> f64 {
        Adhesion::pull_off(self, radii)
    }

    fn under_load(&self, load: f64, radii: [f64; 2]) -> f64 {
        Adhesion::under_load(self, load, radii)
    }

    fn is_equal(&self, other: &dyn AdhesionModel) -> bool {
        (other as &dyn Any).downcast_ref() == Some(self)
    }
}

/// Where some blocks are between touch and separation. In one function, so that the compiler
/// computes only once what the questions share.
struct Holding<'a, A> {
    adhesion: &'a A,
    blocks: &'a UnheldBlocks<'a>,
    held: &'a mut [HeldBlock],
}

impl<A: Adhesion> Work for Holding<'_, A> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        let (adhesion, blocks) = (self.adhesion, self.blocks);
        for (k, held) in self.held.iter_mut().enumerate() {
            let overlap = L::load(token, &blocks.overlap[k]);
            let overlaps = overlap.greater(L::splat(token, 0.0)).bits();
            if blocks.touching[k] | overlaps == 0 {
                continue;
            }
            let radii = PairRadii::<L>::load(token, &blocks.geometry[k]);
            let margin = adhesion.margin(token, &radii, overlap);
            margin.store(&mut held.margin);
            if !A::CHANGES_AREA {
                continue;
            }
            let elastic = adhesion.elastic_overlap(token, &radii, overlap);
            elastic.store(&mut held.elastic_overlap);
            if let Some(last) = blocks.last_overlap {
                let last = L::load(token, &last[k]);
                let elastic = adhesion.elastic_overlap(token, &radii, last);
                elastic.store(&mut held.last_elastic_overlap);
            }
        }
    }
}

/// The answers of an adhesion for some blocks.
struct Answers<'a, A> {
    adhesion: &'a A,
    question: Question,
    blocks: &'a AdhesiveBlocks<'a>,
    out: &'a mut [Lanes16],
}

impl<A: Adhesion> Work for Answers<'_, A> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        let (adhesion, blocks) = (self.adhesion, self.blocks);
        for (k, answer) in self.out.iter_mut().enumerate() {
            let radii = PairRadii::<L>::load(token, &blocks.geometry[k]);
            let overlap = L::load(token, &blocks.overlap[k]);
            let found = match self.question {
                Question::ElasticOverlap => adhesion.elastic_overlap(token, &radii, overlap),
                Question::Force | Question::Potential => {
                    let pairs = AdhesivePairs {
                        radii,
                        overlap,
                        elastic_overlap: L::load(token, &blocks.elastic_overlap[k]),
                    };
                    if self.question == Question::Force {
                        adhesion.force(token, &pairs)
                    } else {
                        adhesion.add_potential(token, &pairs, L::load(token, answer))
                    }
                }
            };
            found.store(answer);
        }
    }
}
