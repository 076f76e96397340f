//! What commands that draw figures are told of their files.

use gshear_report::drawing::Format;

/// Arguments of commands that write figures.
#[derive(Debug, Clone, clap::Args)]
pub struct FigureArguments {
    /// Formats of the files of figures: svg, pdf, png
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "FORMAT,...",
        default_value = "svg"
    )]
    pub formats: Vec<Format>,
}
