//! How far a stage has come, how fast it goes, and the line that says so.

use std::time::{Duration, Instant};

use console::Style;

use gshear_store::status::StageProgress;

/// What is measured, in words.
fn values(progress: &StageProgress) -> Vec<String> {
    let strain = progress.strain.map(|strain| match &*progress.stage {
        "aqs" => format!("strain {strain:.3e}"),
        _ => format!("strain {strain:.5}"),
    });
    [
        strain,
        (progress.stress_ratio).map(|tau| format!("tau {tau:.4}")),
        (progress.shear_stress).map(|stress| format!("stress {stress:.3e}")),
        (progress.residual).map(|force| format!("force {force:.1e}")),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Time over which the speed is averaged (s).
const AVERAGED: f64 = 5.0;
/// Time between two looks at the clock, about.
const LOOK: Duration = Duration::from_millis(100);

/// How fast a stage goes. It looks at the clock at steps about a tenth of a second apart, so that
/// it costs a step nothing.
#[derive(Debug)]
pub struct Pace {
    started: Instant,
    /// The part that was done at the start.
    first: Option<f64>,
    looked: (u64, Instant),
    next: u64,
    /// Steps per second.
    rate: Option<f64>,
}

impl Pace {
    /// At the start of a stage, or where it resumes.
    pub fn new(progress: &StageProgress) -> Self {
        let now = Instant::now();
        Self {
            started: now,
            first: progress.fraction(),
            looked: (progress.step, now),
            next: progress.step + 1,
            rate: None,
        }
    }

    /// Whether to look at the clock after this step.
    pub fn is_due(&self, step: u64) -> bool {
        step >= self.next
    }

    /// Looks at the clock.
    pub fn look(&mut self, step: u64) {
        let (from, at) = self.looked;
        let seconds = at.elapsed().as_secs_f64();
        let steps = step.saturating_sub(from);
        if steps == 0 {
            return;
        }
        // At first one step, then as many as a look is to take, but for sudden changes.
        let wanted = steps as f64 * LOOK.as_secs_f64() / seconds.max(1e-6);
        self.next = step + (wanted as u64).clamp(1, (8 * steps).max(1));
        if seconds < 0.3 * LOOK.as_secs_f64() {
            return;
        }
        self.looked = (step, Instant::now());
        let now = steps as f64 / seconds;
        // The first look counts as much as a long time.
        let weight = 1.0 - (-seconds / AVERAGED).exp();
        self.rate = Some(self.rate.map_or(now, |rate| rate + weight * (now - rate)));
    }

    /// Speed (grain-steps/s), of all ranks together.
    pub fn speed(&self, progress: &StageProgress) -> Option<f64> {
        Some(self.rate? * f64::from(progress.moving?))
    }

    /// Time to the end of the stage (s).
    pub fn left(&self, progress: &StageProgress) -> Option<f64> {
        match (progress.steps, self.rate) {
            (Some(steps), Some(rate)) if rate > 0.0 => {
                Some(steps.saturating_sub(progress.step) as f64 / rate)
            }
            _ => {
                let fraction = progress.fraction()?;
                let done = fraction - self.first.unwrap_or(0.0);
                let elapsed = self.started.elapsed().as_secs_f64();
                (done > 0.0).then(|| elapsed * (1.0 - fraction) / done)
            }
        }
    }
}

/// A time in its two greatest units: 45s, 1m 12s, 3h 5m, 2d 4h.
pub fn duration(seconds: f64) -> String {
    let seconds = if seconds.is_finite() {
        seconds.round() as u64
    } else {
        return "?".into();
    };
    let units = [("d", 86_400), ("h", 3600), ("m", 60), ("s", 1)];
    let largest = units.iter().position(|(_, unit)| seconds >= *unit);
    let (name, unit) = units[largest.unwrap_or(3)];
    let mut text = format!("{}{name}", seconds / unit);
    if let Some((name, next)) = largest.and_then(|at| units.get(at + 1)) {
        let rest = seconds % unit / next;
        if rest > 0 {
            text += &format!(" {rest}{name}");
        }
    }
    text
}

/// The widest and the narrowest bar, its brackets included.
const BAR: [usize; 2] = [32, 10];

/// The line of progress in at most `width` characters: what does not fit is left out, the bar first
/// but for the name, then the speed. `styled`: with colours.
pub fn line(
    progress: &StageProgress,
    speed: Option<f64>,
    left: Option<f64>,
    width: usize,
    styled: bool,
) -> String {
    let fraction = progress.fraction();
    let part = match fraction {
        Some(fraction) => format!("{:.1} %", 100.0 * fraction),
        None => format!("step {}", progress.step),
    };
    let values = values(progress).join(" ");
    let speeds = speed.map_or([String::new(), String::new()], |speed| {
        let millions = 1e-6 * speed;
        ["million", "M"].map(|unit| format!("{millions:.1} {unit} grain-steps/s"))
    });
    let about = match progress.steps {
        Some(_) => "",
        None => "about ",
    };
    let left = left.map_or([String::new(), String::new()], |left| {
        let left = duration(left);
        [format!("{about}{left} left"), left]
    });
    let no = String::new();
    let name = progress.stage.to_string();
    // From the richest to the poorest: name, whether a bar, values, speed, time left.
    let forms = [
        (&name, true, &values, &speeds[0], &left[0]),
        (&name, true, &values, &speeds[1], &left[0]),
        (&no, true, &values, &speeds[1], &left[0]),
        (&no, true, &values, &speeds[1], &left[1]),
        (&no, false, &values, &speeds[1], &left[0]),
        (&no, false, &values, &speeds[1], &left[1]),
        (&no, false, &values, &no, &left[0]),
        (&no, false, &values, &no, &left[1]),
        (&no, false, &no, &no, &left[1]),
        (&no, false, &no, &no, &no),
    ];
    for (name, bar, values, speed, left) in forms {
        let pieces = [name, &part, values, speed, left];
        let shown = pieces.iter().filter(|piece| !piece.is_empty());
        let taken: usize = shown.map(|piece| piece.chars().count() + 1).sum();
        let taken = taken.saturating_sub(1);
        let room = width.saturating_sub(taken + 1).min(BAR[0]);
        let bar = match fraction {
            Some(fraction) if bar && room >= BAR[1] => bar_of(room, fraction),
            Some(_) if bar => continue,
            _ => String::new(),
        };
        if taken > width {
            continue;
        }
        let style =
            |style: Style, text: &str| style.force_styling(styled).apply_to(text).to_string();
        let pieces = [
            style(Style::new().bold(), name),
            style(Style::new().bold(), &part),
            style(Style::new().cyan(), &bar),
            values.clone(),
            style(Style::new().dim(), speed),
            style(Style::new().green(), left),
        ];
        let texts = [name, &part, &bar, values, speed, left];
        let pieces = pieces.iter().zip(texts);
        let kept = pieces.filter(|(_, text)| !text.is_empty());
        let kept: Vec<&str> = kept.map(|(piece, _)| &**piece).collect();
        return kept.join(" ");
    }
    part.chars().take(width).collect()
}

/// A bar of so many characters.
fn bar_of(width: usize, fraction: f64) -> String {
    let inner = width - 2;
    let full = (fraction * inner as f64) as usize;
    let head = usize::from(full < inner);
    let [body, head, rest] = [("=", full), (">", head), (" ", inner - full - head)]
        .map(|(sign, count)| sign.repeat(count));
    format!("[{body}{head}{rest}]")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shear() -> StageProgress {
        StageProgress {
            stage: "shear".into(),
            step: 43_210,
            steps: Some(100_000),
            strain: Some(0.04321),
            stress_ratio: Some(0.45751),
            moving: Some(1000),
            ..StageProgress::default()
        }
    }

    #[test]
    fn a_line_fits_every_width() {
        let mut others = [shear(), shear()];
        (others[0].steps, others[1].strain) = (None, None);
        for progress in [shear()].into_iter().chain(others) {
            for width in 0..200 {
                let text = line(&progress, Some(62.1e6), Some(4000.0), width, false);
                assert!(text.chars().count() <= width, "{width}: {text}");
                let styled = line(&progress, Some(62.1e6), Some(4000.0), width, true);
                assert_eq!(console::strip_ansi_codes(&styled), text);
            }
        }
    }

    #[test]
    fn what_matters_stays() {
        let text = |width| line(&shear(), Some(62.1e6), Some(72.0), width, false);
        for word in ["43.2 %", "strain 0.04321", "tau 0.4575", "1m 12s"] {
            assert!(text(39).contains(word), "{}", text(39));
        }
        let narrow = text(79);
        for words in ["62.1 M grain-steps/s 1m 12s left", "[====>"] {
            assert!(narrow.contains(words), "{narrow}");
        }
        let wide = text(150);
        assert!(wide.starts_with("shear 43.2 % [="), "{wide}");
        assert!(wide.contains("million grain-steps/s"), "{wide}");
    }

    #[test]
    fn times_have_two_units() {
        let texts = [0.2, 45.0, 60.0, 72.0, 3600.0, 11_100.0, 187_200.0].map(duration);
        assert_eq!(texts, ["0s", "45s", "1m", "1m 12s", "1h", "3h 5m", "2d 4h"]);
    }

    /// The time left follows the steps, or the part that is done.
    #[test]
    fn the_pace_is_that_of_the_steps() {
        let mut pace = Pace::new(&shear());
        assert!(pace.is_due(43_211) && pace.left(&shear()).is_none());
        pace.looked.1 -= Duration::from_secs(1);
        pace.look(43_210 + 1000);
        let rate = pace.rate.expect("a rate");
        assert!((rate / 1000.0 - 1.0).abs() < 0.1, "{rate}");
        assert!(!pace.is_due(44_211));
        let later = StageProgress {
            step: 44_210,
            ..shear()
        };
        assert_eq!(pace.left(&later), Some(55_790.0 / rate));
        assert_eq!(pace.speed(&later), Some(1000.0 * rate));
    }
}
