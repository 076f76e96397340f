//! A law beside an adhesion.

use std::sync::Arc;

use crate::contact::adhesion::{AdhesionModel, AdhesiveBlocks, Question};
use crate::contact::model::{Elastic, Layout, PairModel};
use crate::contact::stiffness::{Derivatives, SpringState, Stiffness};
use crate::dimension::Dimension;
use crate::kernel::{PairForce, Pass, PassOutcome, Scratch};
use crate::simd::{Isa, Lanes16};

/// A law with an adhesion.
#[derive(Debug)]
pub(crate) struct Adhering<D: Dimension> {
    law: Box<dyn PairForce<D>>,
    adhesion: Arc<dyn AdhesionModel>,
}

impl<D: Dimension> Adhering<D> {
    /// The law beside this adhesion, or as it is without one.
    pub fn beside(
        law: Box<dyn PairForce<D>>,
        adhesion: Option<&Arc<dyn AdhesionModel>>,
    ) -> Box<dyn PairForce<D>> {
        match adhesion {
            Some(adhesion) => Box::new(Self {
                law,
                adhesion: Arc::clone(adhesion),
            }),
            None => law,
        }
    }
}

/// The law's derivatives by δ are those by the overlap that it is given, times its slope.
impl<D: Dimension> Stiffness for Adhering<D> {
    fn derivatives(&self, state: &SpringState) -> Derivatives {
        let contact = self.adhesion.contact(state.radii, state.overlap);
        if contact.elastic_overlap <= 0.0 {
            return Derivatives {
                normal: -contact.force,
                normal_slope: -contact.force_slope,
                ..Derivatives::default()
            };
        }
        let mut d = self.law.derivatives(&SpringState {
            overlap: contact.elastic_overlap,
            ..*state
        });
        for force in [&mut d.tangential, &mut d.rolling, &mut d.twisting] {
            force.slope = force.slope.map(|slope| slope * contact.elastic_slope);
        }
        d.normal -= contact.force;
        d.normal_slope = d.normal_slope * contact.elastic_slope - contact.force_slope;
        d
    }

    /// Dampers are those of the overlap that the law is given.
    fn dampers(&self, state: &SpringState) -> Derivatives {
        let contact = self.adhesion.contact(state.radii, state.overlap);
        if contact.elastic_overlap <= 0.0 {
            return Derivatives::default();
        }
        self.law.dampers(&SpringState {
            overlap: contact.elastic_overlap,
            ..*state
        })
    }

    fn idle_derivatives(&self, state: &SpringState) -> Option<Derivatives> {
        let contact = self.adhesion.contact(state.radii, state.overlap);
        Some(Derivatives {
            normal: -contact.force,
            normal_slope: -contact.force_slope,
            ..Derivatives::default()
        })
    }

    fn gap(&self, _: [u64; 2], radii: [f64; 2]) -> f64 {
        self.adhesion.gap(radii)
    }
}

impl<D: Dimension> PairModel for Adhering<D> {
    fn layout(&self) -> Layout {
        self.law.layout()
    }

    fn set_parameters(
        &self,
        isa: Isa,
        geometry: &[[Lanes16; 2]],
        kinds: &[u16],
        out: &mut [Lanes16],
    ) {
        self.law.set_parameters(isa, geometry, kinds, out);
    }

    fn largest_normal_force(&self, radius: f64) -> f64 {
        let elastic = self.law.largest_normal_force(radius);
        elastic + self.adhesion.under_load(elastic, [radius; 2])
    }

    fn energies(&self, isa: Isa, blocks: &Elastic<'_>, out: &mut [[Lanes16; 3]]) {
        let mut adhesive = AdhesiveBlocks {
            geometry: blocks.geometry,
            overlap: blocks.overlap,
            elastic_overlap: blocks.overlap,
        };
        let mut elastic_overlap = vec![Lanes16::ZERO; out.len()];
        self.adhesion.answer(
            isa,
            Question::ElasticOverlap,
            &adhesive,
            &mut elastic_overlap,
        );
        adhesive.elastic_overlap = &elastic_overlap;
        let of_law = Elastic {
            overlap: adhesive.elastic_overlap,
            ..*blocks
        };
        self.law.energies(isa, &of_law, out);
        let mut normal: Vec<Lanes16> = out.iter().map(|energies| energies[0]).collect();
        if self.adhesion.acts_across_gaps() {
            // Of pairs across a gap the law says nothing.
            for ((energies, normal), overlap) in out.iter_mut().zip(&mut normal).zip(of_law.overlap)
            {
                for (lane, overlap) in overlap.0.iter().enumerate() {
                    if *overlap <= 0.0 {
                        normal.0[lane] = 0.0;
                        energies.iter_mut().for_each(|lanes| lanes.0[lane] = 0.0);
                    }
                }
            }
        }
        self.adhesion
            .answer(isa, Question::Potential, &adhesive, &mut normal);
        for (energies, normal) in out.iter_mut().zip(normal) {
            energies[0] = normal;
        }
    }
}

impl<D: Dimension> PairForce<D> for Adhering<D> {
    fn pass(&self, pass: Pass<'_, D>, scratch: &mut Scratch<D>) -> PassOutcome {
        self.law.pass(pass.beside(self.adhesion.as_ref()), scratch)
    }
}
