//! What the run computes of its frames: `[analysis]`.

use crate::checker::Checker;
use crate::raw;
use crate::scene::{Analysis, Dimensions, Motion, Output, Shear};
use crate::words::show;

pub(super) fn check(
    c: &mut Checker<'_>,
    analysis: &raw::Analysis,
    dimension: Dimensions,
    shear: &Shear,
    output: &Output,
) -> Analysis {
    let scalars = c.flag_or_default(&analysis.scalars);
    let strain = c.number(&analysis.strain);
    let start = c.number(&analysis.start);
    if scalars && dimension == Dimensions::Three {
        c.refuse(
            &analysis.scalars,
            "the scalars of frames are those of disks; leave it out with dimension = 3",
        );
    }
    if let Motion::Protocol(_) = shear.motion {
        let why = "does not apply to the parts of shear.protocol";
        c.useless(&analysis.strain, why);
        c.useless(&analysis.start, why);
        if scalars {
            c.useless(&analysis.scalars, why);
        }
    }
    let found = Analysis {
        scalars,
        strain: strain.unwrap_or(output.frame_strain),
        start: start.unwrap_or(output.frame_start),
    };
    if scalars && output.rows_in(found.strain).is_none() {
        let places = [analysis.strain.place(), analysis.scalars.place()];
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
