//! Athermal quasi-static shear: strain steps, each brought to mechanical equilibrium, and the birth of the first complex pair.

use super::equilibrium::{LONGEST, displace};
use super::observe::{Observed, observe};
use super::record::Recorder;
use super::spectrum::{Eigenvalues, Whole};
use super::{Birth, Header, Held, PeriodicRun, Progress, Resumed};
use gshear_dem::kernel::PairForce;
use gshear_dem::dimension::Dimension;
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Failure;
use gshear_dem::kernel::ContactForces;
use crate::periodic::equilibrium::Found;
use crate::run::Ending;
use gshear_dem::system::System;

impl PeriodicRun<'_> {
    /// The strain steps, and what follows them.
    pub(super) fn shear<D: Dimension>(
        self,
        law: &dyn PairForce<D>,
        state: Held,
        resumed: Option<Resumed>,
    ) -> Result<Ending, Failure> {
        let (exchange, scene) = (self.exchange, self.scene);
        let mut system = self.system::<D>(state.cell)?;
        // With the forces of the state: computing them anew would not be what the run that was not stopped does.
        state.put_back(exchange, &mut system, law)?;
        if let (Some(newtonian), Some(resumed)) = (&scene.newtonian, &resumed)
            && resumed.header.newtonian.is_some()
        {
            return self.newtonian(
                &mut system,
                law,
                newtonian,
                &resumed.header,
                resumed.travels.as_deref(),
            );
        }
        let header = resumed.map(|resumed| resumed.header);
        let mut recorder = Recorder::open(exchange, scene, &mut system, &self.options.out, &header)?;
        let mut progress = header
            .as_ref()
            .map_or_else(Progress::default, |h| h.progress);
        let mut samples = ContactForces::default();
        if header.is_none() {
            let found = self.relax(&mut system, law)?;
            self.look(
                &mut system,
                law,
                &mut progress,
                found,
                &mut recorder,
                &mut samples,
            )?;
        }
        let mut stopped = false;
        while progress.steps < scene.aqs.steps && !self.enough(&progress) && !stopped {
            let held = Held::of(&mut system, law);
            let found = self.strain(&mut system, law, scene.aqs.strain_step)?;
            let before = progress;
            progress.steps += 1;
            progress.offset = system.cell.sheared.map_or(0.0, |s| s.offset);
            progress.fell_back += u64::from(found.fell_back);
            self.look(
                &mut system,
                law,
                &mut progress,
                found,
                &mut recorder,
                &mut samples,
            )?;
            if before.birth.is_none() && progress.pairs > 0 {
                let after = Held::of(&mut system, law);
                let birth = self.birth(&mut system, law, held, before.steps)?;
                progress.birth = Some(birth);
                self.terminal.born(&birth);
                after.put_back(exchange, &mut system, law)?;
            }
            stopped = self.asked_to_stop() || self.options.stop_at == Some(progress.steps);
            let ends = progress.steps == scene.aqs.steps || self.enough(&progress);
            if stopped || ends || recorder.saves.due(exchange) {
                let written = recorder.flush(exchange)?;
                recorder.checkpoint(exchange, &mut system, law, progress, written)?;
            }
        }
        let [frames, rows] = recorder.flush(exchange)?;
        let digest = recorder.finish(exchange, &mut system, law, &progress)?;
        if stopped && progress.steps < scene.aqs.steps && !self.enough(&progress) {
            self.terminal
                .stopped(&self.options.out, "aqs", progress.steps);
            return Ok(Ending::Stopped);
        }
        self.terminal.strained(&progress, &digest);
        match &scene.newtonian {
            Some(newtonian) => {
                let header = Header {
                    progress,
                    frames,
                    rows,
                    newtonian: None,
                };
                self.newtonian(&mut system, law, newtonian, &header, None)
            }
            None => Ok(Ending::Done),
        }
    }

    /// Whether the pair is such that the strain steps end.
    fn enough(&self, progress: &Progress) -> bool {
        let until = self.scene.aqs.until_imaginary;
        let great = |pair: super::Pair| pair.lambda_i >= until;
        until > 0.0 && progress.pairs == 1 && progress.pair.is_some_and(great)
    }

    /// One strain step by `by`, brought to rest.
    fn strain<D: Dimension>(
        &self,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        by: f64,
    ) -> Result<Found, Failure> {
        let height = system.cell.sheared.map_or(0.0, |s| s.height);
        let longest = LONGEST * self.scene.sample.mean_diameter;
        let parts = (by * height / longest).ceil().max(1.0);
        for _ in 0..parts as u64 {
            system.list.widen(4.0 * longest);
            system.rebuild(self.exchange, law, &mut NoWalls)?;
            let part = by / parts;
            let grains = system.grains();
            let affine = |g: usize| {
                let up = grains.fields(g)[D::UP];
                [[part * up, 0.0, 0.0], [0.0; 3]]
            };
            let moves: Vec<_> = (0..grains.owned).map(affine).collect();
            if !displace(self.exchange, system, law, &moves, part * height)? {
                return Err(system.explain(self.exchange, None));
            }
        }
        self.relax(system, law)
    }

    /// Measures the packing after a strain step.
    fn look<D: Dimension>(
        &self,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        progress: &mut Progress,
        found: Found,
        recorder: &mut Recorder,
        samples: &mut ContactForces,
    ) -> Result<(), Failure> {
        let (exchange, scene) = (self.exchange, self.scene);
        let observed = observe(exchange, system, law, samples, scene.sample.grains);
        let eigenvalues = match scene.aqs.spectrum {
            true => Some(
                Whole::gather(exchange, system, law).eigenvalues::<D>(
                    exchange,
                    system,
                    law,
                )?,
            ),
            false => None,
        };
        if let Some(eigenvalues) = &eigenvalues {
            (progress.pairs, progress.pair) = (eigenvalues.pairs(), eigenvalues.greatest_pair());
        }
        let row = Row {
            strain: scene.aqs.strain_step * progress.steps as f64,
            offset: progress.offset,
            observed,
            found,
            residual: super::equilibrium::residual(exchange, system, 0.0),
            eigenvalues,
        };
        recorder.strain_row(exchange, progress.steps, &row)?;
        self.terminal.strain_step(progress.steps, &row);
        if recorder.frame_due(progress.steps) {
            recorder.strain_frame(exchange, system, law, samples, progress.steps)?;
        }
        Ok(())
    }

    /// By bisection between the states before and after a strain step, from the state before it.
    fn birth<D: Dimension>(
        &self,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        mut before: Held,
        steps: u64,
    ) -> Result<Birth, Failure> {
        let (exchange, aqs) = (self.exchange, &self.scene.aqs);
        let start = aqs.strain_step * steps as f64;
        let (mut low, mut high) = (0.0, aqs.strain_step);
        while high - low > aqs.birth_precision {
            let middle = 0.5 * (low + high);
            before.clone().put_back(exchange, system, law)?;
            self.strain(system, law, middle - low)?;
            let whole = Whole::gather(exchange, system, law);
            if whole
                .eigenvalues::<D>(exchange, system, law)?
                .pairs()
                > 0
            {
                high = middle;
            } else {
                low = middle;
                before = Held::of(system, law);
            }
        }
        Ok(Birth {
            before: start + low,
            after: start + high,
        })
    }
}

/// What is found after a strain step.
pub(crate) struct Row {
    pub strain: f64,
    pub offset: f64,
    pub observed: Observed,
    pub found: Found,
    pub residual: f64,
    pub eigenvalues: Option<Eigenvalues>,
}
