//! What the run computes of its frames: `[analysis]`.

use super::{Checker, Key, NOT_NEGATIVE, POSITIVE, key};
use crate::raw::{self, show};
use crate::scene::*;

pub(super) fn check(
    c: &mut Checker<'_>,
    analysis: raw::Analysis,
    dimension: Dimensions,
    shear: &Shear,
    output: &Output,
) -> Analysis {
    let scalars_key = key!(analysis.scalars);
    let strain_key = key!(analysis.strain);
    let start_key = key!(analysis.start);
    let scalars = c.flag(&scalars_key).unwrap_or(false);
    let strain = c.number(&strain_key, &POSITIVE);
    let start = c.number(&start_key, &NOT_NEGATIVE);
    if scalars && dimension == Dimensions::Three {
        c.refuse(
            &scalars_key,
            "the scalars of frames are those of disks; leave it out with dimension = 3",
        );
    }
    if let Motion::Protocol(_) = shear.motion {
        let why = "is for one speed, and shear.protocol has several";
        c.useless(&strain_key, why);
        c.useless(&start_key, why);
        if scalars {
            c.useless(&scalars_key, why);
        }
    }
    let found = Analysis {
        scalars,
        strain: strain.unwrap_or(output.frame_strain),
        start: start.unwrap_or(output.frame_start),
    };
    if scalars && output.rows_in(found.strain).is_none() {
        let places = [
            (strain_key.path, strain_key.offset()),
            (scalars_key.path, scalars_key.offset()),
        ];
        c.refuse_among(
            &places,
            &format!(
                "every frame that is analysed needs a row of the time series: analysis.strain (default output.frame_strain) must be \
                 a whole number of output.series_strain = {}, found {}",
                show(output.series_strain),
                show(found.strain)
            ),
        );
    }
    found
}
