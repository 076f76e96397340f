//! The HTML page of a run's report: one self-contained file.

use super::ReportFigure;
use super::drawing::Format;
use super::summary::{self, Summary, is_imposed, latter_half};
use super::text::escape;
use gshear_analysis::moments::extent;
use gshear_analysis::phases::PhaseKind;
use gshear_analysis::time_mean::TimeMean;
use gshear_store::run_reader::{RunFile, RunStage};
use gshear_store::status::RunCondition;

/// Names and values of the table at the top, in HTML.
pub(crate) type Facts = Vec<(&'static str, String)>;

/// What a page says.
pub(crate) struct Page<'a> {
    /// What was run.
    pub what: &'a str,
    /// What has become of the run.
    pub condition: &'a RunCondition,
    /// The table at the top.
    pub facts: Facts,
    /// The figures.
    pub figures: &'a [ReportFigure],
    /// Address of the time series from the page.
    pub series: &'a str,
    /// Formats of the files of figures.
    pub formats: &'a [Format],
    /// HTML after the figures.
    pub note: &'a str,
}

/// Returns the report as HTML, figures and style included.
pub fn html(run: &RunFile, page: Page<'_>) -> String {
    let Page {
        what,
        condition,
        facts,
        figures,
        series,
        formats,
        note,
    } = page;
    let title = escape(&title(run));
    let lead = match condition {
        RunCondition::Finished => format!("{what}: a finished run of gshear-mpi."),
        other => format!(
            "{what}: a run of gshear-mpi, {}. The report covers what it has written.",
            escape(&other.to_string())
        ),
    };
    let drawn = self::figures(figures, series, formats);
    let parameters = run.parameters().iter().filter(|(name, _)| *name != "scene");
    let parameters = parameters.map(|(name, value)| (escape(name), escape(&value.to_string())));
    let body = format!(
        "{}{}<h2 id=\"figures\">Figures</h2>\n{drawn}{note}<h2 id=\"parameters\">Parameters</h2>\n{}\
         <details id=\"scene\"><summary>Scene with all defaults filled in</summary>\n<pre>{}</pre></details>\n",
        table(facts.into_iter().map(|(name, value)| (name.into(), value))),
        contents(
            figures,
            &[
                ("parameters", "Parameters"),
                ("scene", "Scene with all defaults filled in")
            ]
        ),
        table(parameters),
        escape(run.scene())
    );
    document(&title, &lead, &body)
}

/// The fact that leads to the page of a later stage, in a folder of its name.
pub(crate) fn link_to(stage: RunStage) -> (&'static str, String) {
    let what = match stage {
        RunStage::Shear => "shear at a rate",
        RunStage::Strain => "quasi-static strain",
        RunStage::Newtonian => "Newton's equations",
    };
    let link = format!("<a href=\"{}/index.html\">{what}</a>", stage.name());
    ("Then", link)
}

/// Says why there are no maps, or not of the largest drop.
pub(crate) fn note_on_maps(run: &RunFile, summary: &Summary) -> &'static str {
    let expected = summary::has_phases(run, &summary.phases);
    match &summary.event {
        _ if run.dimension().axes() != 2 => "",
        None if expected => {
            "<p>No slip phase has a frame before and after it, so there are no maps: \
             write frames more often (output.frame_strain), or keep checkpoints \
             (output.keep_checkpoints), from which the report computes the drop again.</p>\n"
        }
        Some(event) if Some(event.drop) != summary.drop => {
            "<p>The maps do not show the largest drop, which has no frames before and after it. \
             With kept checkpoints (output.keep_checkpoints) the report computes it again.</p>\n"
        }
        Some(event) if !event.is_exact => {
            "<p>The maps show the frames around the largest drop, which is shorter: τ of these frames \
             differs by less than the drop. With kept checkpoints (output.keep_checkpoints) the report \
             computes the drop again and shows the states right before and after it.</p>\n"
        }
        _ => "",
    }
}

/// Returns a page that stands alone; title, lead and body are HTML.
pub(crate) fn document(title: &str, lead: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n<title>{title}</title>\n\
         <style>\n{}</style>\n</head>\n<body>\n<h1>{title}</h1>\n<p class=\"lead\">{lead}</p>\n{body}<script>\n{}</script>\n</body>\n</html>\n",
        include_str!("page.css"),
        include_str!("page.js")
    )
}

/// Returns a list of the figures, and of sections after them (id and title), with links.
pub(crate) fn contents(figures: &[ReportFigure], sections: &[(&str, &str)]) -> String {
    let figures = figures.iter().map(|figure| {
        let words = figure.name.replace('-', " ").replace("dmin", "D²min");
        entry(&figure.name, &escape(&words))
    });
    let sections = sections.iter().map(|(id, title)| entry(id, title));
    let entries: String = figures.chain(sections).collect();
    format!("<nav>\n<h2>Contents</h2>\n<ol>\n{entries}</ol>\n</nav>\n")
}

fn entry(id: &str, text: &str) -> String {
    format!("<li><a href=\"#{id}\">{text}</a></li>\n")
}

/// Returns a figure with its drawing in the page, and links to its files; the caption is HTML.
/// `data`: the file of its numbers.
pub fn figure(name: &str, caption: &str, data: &str, svg: &str, formats: &[Format]) -> String {
    let files = formats
        .iter()
        .map(|format| format!("{name}.{}", format.ending()));
    let files = std::iter::once(data.to_string()).chain(files);
    let links: Vec<String> = files
        .map(|file| format!("<a href=\"{file}\">{file}</a>"))
        .collect();
    let described = format!("<svg role=\"img\" aria-label=\"{}\" ", alternative(caption));
    format!(
        "<figure id=\"{name}\">\n{}<figcaption>{caption} {}</figcaption>\n</figure>\n",
        svg.replacen("<svg ", &described, 1),
        links.join(", ")
    )
}

/// Returns the figures of a report, each with the file of its numbers. `series`: that of the time
/// series.
pub fn figures(figures: &[ReportFigure], series: &str, formats: &[Format]) -> String {
    let figures = figures.iter().map(|shown| {
        let data = shown.data_file(series);
        figure(&shown.name, &shown.caption, &data, &shown.svg, formats)
    });
    figures.collect()
}

/// The scene's title, or the path of the run.
fn title(run: &RunFile) -> String {
    let scene = run.scene().parse::<toml::Table>().ok();
    let title = (scene.as_ref()).and_then(|scene| scene.get("title")?.as_str());
    title.map_or_else(|| run.path().display().to_string(), str::to_string)
}

/// Returns what is said of any run.
pub fn identity(run: &RunFile, condition: &RunCondition) -> Facts {
    let shape = ["Disks", "Spheres"][run.dimension().axes() - 2];
    let all = run.grains().count();
    let walls = run.grains().body.iter().filter(|body| **body != 0).count();
    let grains = match walls {
        0 => all.to_string(),
        walls => format!("{all}, including {walls} in the walls"),
    };
    let rows = format!("{}, {}", run.frames(), run.series().rows());
    let digest = run.digest();
    let digest = digest.map_or("none".into(), escape);
    vec![
        ("Run", escape(&run.path().display().to_string())),
        ("State", escape(&condition.to_string())),
        (shape, grains),
        ("Frames, rows of the time series", rows),
        ("Digest", digest),
    ]
}

/// How far a run has come, or how fast it flows.
fn progress(run: &RunFile) -> (&'static str, String) {
    let strain = run.series().column("strain");
    if !run.boundary().has_top() {
        let TimeMean { mean, error, .. } = run.series().mean("mean_velocity", latter_half(run));
        (
            "Mean velocity in the latter half, standard error",
            format!("{mean:.4e} m/s ± {error:.1e} m/s"),
        )
    } else if is_imposed(run) {
        let [least, most] = extent(strain.iter().copied().chain([0.0])).map(|end| 100.0 * end);
        let range = format!("{least:.4} … {most:.4} %");
        ("Shear strain, least and greatest", range)
    } else {
        let last = match strain.last() {
            Some(strain) => format!("{:.4} %", 100.0 * strain),
            None => "none".into(),
        };
        ("Shear strain reached", last)
    }
}

/// Returns the numbers of a run between walls.
pub fn facts(run: &RunFile, summary: &Summary, condition: &RunCondition) -> Facts {
    let mut facts = identity(run, condition);
    facts.push(progress(run));
    let stress = summary.stress;
    let [mean, error, deviation] = [stress.mean, stress.error, stress.deviation].map(number);
    let name = "τ in the latter half: ⟨S⟩/⟨N⟩ ± standard error, standard deviation";
    facts.push((name, format!("{mean} ± {error}, {deviation}")));
    if summary::has_phases(run, &summary.phases) {
        for (kind, name) in [
            (PhaseKind::Stick, "Stick phases"),
            (PhaseKind::Slip, "Slip phases"),
        ] {
            let [long, short] = summary.count(kind);
            let all = long + short;
            let text = format!("{all}: {long} long (more than 3 Δγ), {short} short");
            facts.push((name, text));
        }
    }
    if let Some(drop) = &summary.drop {
        let [from, to] = drop.strain.map(|strain| format!("{:.5}", 100.0 * strain));
        let change = format!("Δτ<sub>p</sub> = {:.5}", drop.change);
        let text = format!("{change} from γ = {from} % to {to} %");
        facts.push(("Largest drop", text));
    }
    let event = summary.event.as_ref();
    if let Some(greatest) = event.and_then(|event| event.frames.greatest_dmin(run.grains())) {
        let name = "Greatest D²<sub>min</sub>/r̄² over the mapped drop";
        facts.push((name, format!("{greatest:.3e}")));
    }
    for (parameter, name) in [
        ("inertial_number", "Inertial number I"),
        ("stiffness_number", "Stiffness number κ"),
    ] {
        // That of the first part of a protocol is not that of the run.
        let is_of_first_part = parameter == "inertial_number" && run.has_protocol();
        if let Some(value) = run.number(parameter)
            && !is_of_first_part
        {
            let definition = match run.text(&format!("{parameter}_definition")) {
                Some(definition) => format!(" ({})", escape(definition)),
                None => String::new(),
            };
            facts.push((name, format!("{value:.4e}{definition}")));
        }
    }
    if let Some(speed) = run.number("speed") {
        let millions = speed / 1e6;
        let text = format!("{millions:.2} million grain-steps per second and rank");
        facts.push(("Speed", text));
    }
    facts
}

/// A caption without marks, as the text of a picture that is not seen.
fn alternative(caption: &str) -> String {
    let parts = caption.split('<');
    let texts = parts.map(|part| part.split_once('>').map_or(part, |(_, text)| text));
    texts.collect::<String>().replace('"', "")
}

fn number(value: f64) -> String {
    if value.is_finite() {
        format!("{value:.4}")
    } else {
        "undefined".into()
    }
}

/// Returns a table of names and values, both HTML.
pub fn table(rows: impl IntoIterator<Item = (String, String)>) -> String {
    let rows = rows.into_iter();
    let rows: String = rows
        .map(|(name, value)| format!("<tr><th>{name}</th><td>{value}</td></tr>\n"))
        .collect();
    format!("<table>\n{rows}</table>\n")
}
