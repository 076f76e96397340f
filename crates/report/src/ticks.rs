//! Axis ticks at round numbers, and SI prefixes.
//!
//! Own code because the key points of plotters come without labels, and labels need the decimals of
//! the step.

/// A tick: its position and its label.
pub(crate) type Tick = (f64, String);

/// Returns about `wanted` round numbers within `low` … `high`, in steps of 1, 2 or 5 times a power
/// of ten.
pub fn round(low: f64, high: f64, wanted: usize) -> Vec<Tick> {
    let span = high - low;
    if !(span.is_finite() && span > 0.0) {
        return Vec::new();
    }
    let raw = span / wanted.max(1) as f64;
    let power = raw.log10().floor();
    let unit = 10f64.powf(power);
    let mut factors = [1.0, 2.0, 5.0].into_iter();
    let factor = factors.find(|factor| factor * unit >= raw * 0.999);
    let factor = factor.unwrap_or(10.0);
    let step = factor * unit;
    let decimals = if factor == 10.0 { -power - 1.0 } else { -power }.max(0.0) as usize;
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    let ticks = (first..=last).map(|k| {
        let value = k as f64 * step;
        (value, format!("{value:.decimals$}").replace('-', "−"))
    });
    ticks.collect()
}

/// Returns ticks of [`round`], with a power of ten if the numbers are small or large.
pub fn scientific(range: [f64; 2], wanted: usize) -> Vec<Tick> {
    let greatest = range[0].abs().max(range[1].abs());
    if (1e-3..1e5).contains(&greatest) {
        return round(range[0], range[1], wanted);
    }
    let power = greatest.log10().floor();
    let unit = 10f64.powf(power);
    let power = format!("{power}").replace('-', "−");
    let ticks = round(range[0] / unit, range[1] / unit, wanted);
    let ticks = ticks.into_iter().map(|(value, text)| {
        let text = if value == 0.0 {
            "0".into()
        } else {
            format!("{text}·10^{{{power}}}")
        };
        (value * unit, text)
    });
    ticks.collect()
}

/// Returns ticks at the powers of ten within 10^low … 10^high, on an axis of log10; every second,
/// third, … power if there are more than `most`.
pub fn decades(low: f64, high: f64, most: usize) -> Vec<Tick> {
    let (first, last) = ((low - 1e-9).ceil() as i64, (high + 1e-9).floor() as i64);
    let step = ((last - first).max(0) as usize / most.max(1) + 1) as i64;
    let shown = (first..=last).filter(|k| k.rem_euclid(step) == 0);
    let ticks = shown.map(|k| {
        let power = k.to_string().replace('-', "−");
        (k as f64, format!("10^{{{power}}}"))
    });
    ticks.collect()
}

/// Returns ticks of `low` … `high` as parts of that range, as they lie on a colour bar.
pub(crate) fn on_bar(ticks: Vec<Tick>, low: f64, high: f64) -> Vec<Tick> {
    let ticks = ticks.into_iter();
    let ticks = ticks.map(|(value, label)| ((value - low) / (high - low), label));
    ticks.collect()
}

/// Returns the factor and the SI prefix that give a value one to three digits before the decimal
/// point.
pub fn prefix(value: f64) -> (f64, &'static str) {
    // From 10⁻¹² to 10¹².
    const PREFIXES: [&str; 9] = ["p", "n", "µ", "m", "", "k", "M", "G", "T"];
    let thousands = (value.abs().log10() / 3.0).floor();
    let thousands = if thousands.is_finite() {
        (thousands as i32).clamp(-4, 4)
    } else {
        0
    };
    let name = PREFIXES[(thousands + 4) as usize];
    (10f64.powi(-3 * thousands), name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ticks: Vec<Tick>) -> Vec<String> {
        ticks.into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round_and_within_the_axis() {
        assert_eq!(labels(round(0.0, 10.0, 5)), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(labels(round(-0.13, 0.27, 4)), ["−0.1", "0.0", "0.1", "0.2"]);
        let narrow = labels(round(5.1234, 5.1291, 3));
        assert_eq!(narrow, ["5.124", "5.126", "5.128"]);
        let wide = labels(round(0.0, 70.0, 10));
        assert_eq!(wide, ["0", "10", "20", "30", "40", "50", "60", "70"]);
        assert!(round(1.0, 1.0, 5).is_empty() && round(f64::NAN, 1.0, 5).is_empty());
    }

    #[test]
    fn decades_thin_out() {
        let all = labels(decades(-3.2, 0.0, 9));
        assert_eq!(all, ["10^{−3}", "10^{−2}", "10^{−1}", "10^{0}"]);
        assert_eq!(labels(decades(0.0, 8.0, 4)).len(), 3);
    }

    #[test]
    fn prefixes_leave_one_to_three_digits() {
        let values = [
            (48e-6, 48.0, "µ"),
            (0.75, 750.0, "m"),
            (1.0, 1.0, ""),
            (13e3, 13.0, "k"),
        ];
        for (value, shown, name) in values {
            let (factor, prefix) = prefix(value);
            assert_eq!(prefix, name, "{value}");
            assert!(
                (value * factor - shown).abs() < 1e-9 * shown,
                "{value}: {factor}"
            );
        }
        assert_eq!(prefix(0.0), (1.0, ""));
    }
}
