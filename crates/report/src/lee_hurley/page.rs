//! The HTML page of the study: the figures in the order of the paper, and the tables of numbers.

use super::numbers::QuotedNumber;
use super::studied::Studied;
use super::{Drawn, Figure};
use crate::page::{document, escape, links};

/// Returns the page as HTML, which refers to the figures as files in the same folder. `seeds`: name
/// and SVG of the figures over several seeds.
pub fn html(
    runs: &[Studied],
    numbers: &[QuotedNumber],
    drawn: &[Drawn],
    seeds: &[(String, String)],
) -> String {
    let mut body = String::new();
    for figure in drawn {
        match figure {
            Ok(figure) => body += &shown(figure),
            Err((number, why)) => body += &format!("<p>Figure {number}: {}.</p>\n", escape(why)),
        }
    }
    let mut ensemble = String::new();
    for (name, _) in seeds {
        ensemble += &format!(
            "<figure>\n<img src=\"{name}\" alt=\"{name}\" style=\"max-width: 100%\"/>\n<figcaption>Runs that differ in their seeds \
             only: mean coefficients with standard errors; points with a median p above 0.05 are left out. \
             {}</figcaption>\n</figure>\n",
            links(
                name.trim_end_matches(".svg"),
                &["ensemble-correlations.csv", "ensemble.csv"]
            )
        );
    }
    let mut tables = String::new();
    for run in runs {
        let lines = numbers.iter().filter(|number| number.run == run.label);
        let rows: String = lines
            .map(|line| {
                let cells = [&line.what, &line.paper, &line.ours].map(|text| escape(text));
                format!(
                    "<tr><th>{}</th><td>{}</td><td>{}</td></tr>\n",
                    cells[0], cells[1], cells[2]
                )
            })
            .collect();
        tables += &format!(
            "<h3>{}</h3>\n<p>{}, the {} sample.</p>\n<table>\n<tr><th></th><td>paper</td><td>this run</td></tr>\n{rows}</table>\n",
            escape(&run.label),
            escape(&run.path),
            run.size.name()
        );
    }
    let body = format!(
        "<h2>Figures</h2>\n<p>Figure 1 is a drawing of the set-up.</p>\n{body}{ensemble}<h2>Numbers of the paper and of these runs</h2>\n\
         <p>Coefficients below 0.4 are called weak, from 0.6 on strong; the paper uses the words without numbers.</p>\n{tables}"
    );
    document(
        "The study of Lee and Hurley",
        "The figures of \"Microscopic dynamics of particle rearrangement and its correlation with stick-slip behavior in \
         granular shear\" for these runs, with the numbers of the paper. Each figure links to its data as CSV.",
        &body,
    )
}

fn shown(figure: &Figure) -> String {
    let name = figure.name();
    let tables: Vec<String> = (figure.data.iter())
        .map(|(end, _)| format!("{name}{end}"))
        .collect();
    format!(
        "<figure id=\"{name}\">\n<img src=\"{name}.svg\" alt=\"Figure {0}\" style=\"max-width: 100%\"/>\n\
         <figcaption>Figure {0}. {1} {2}</figcaption>\n</figure>\n",
        figure.number,
        figure.caption,
        links(&name, &tables)
    )
}
