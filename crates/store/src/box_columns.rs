//! Columns of the time series of a run in a periodic box.

use std::sync::LazyLock;

use gshear_dem::columns::Column;

gshear_dem::columns! {
    /// One row of the time series of the strain steps. What was not computed is NaN.
    pub struct AqsRow {
        /// γ; ε (biaxial); decrease of volume (compression); accumulated (protocol)
        strain: "1",
        /// Lees–Edwards offset: displacement of the image above along x
        image_offset: "m",
        /// -1/V Σ r^x F^z over the contacts (F^y in 2D)
        shear_stress: "Pa",
        /// 1/(dV) Σ r·F over the contacts, in d dimensions
        pressure: "Pa",
        /// energy stored in the contacts
        elastic_energy: "J",
        /// number of contacts
        contacts: "1",
        /// mean number of contacts of a grain
        coordination: "1",
        /// sliding contacts over all contacts
        sliding_fraction: "1",
        /// largest net force on a grain, or torque over its radius
        residual: "N",
        /// factorisations of the relaxation
        factorisations: "1",
        /// overdamped steps of the relaxation
        overdamped_steps: "1",
        /// 1 if Newton's method did not converge
        fell_back: "1",
        /// number of complex pairs
        pairs: "1",
        /// smallest imaginary part
        imaginary_least: "s-2",
        /// largest imaginary part
        imaginary_greatest: "s-2",
        /// real part of the pair with the largest imaginary part
        pair_real: "s-2",
        /// smallest real part of the eigenvalues that are not zero
        least_real: "s-2",
        /// number of zero modes
        zero_modes: "1",
        /// volume (area in 2D) of the grains over that of the box
        solid_fraction: "1",
        /// L_x
        length_x: "m",
        /// L_y
        length_y: "m",
        /// L_z; NaN in 2D
        length_z: "m",
        /// 1/V Σ r^x F^x over the contacts, compression positive
        stress_xx: "Pa",
        /// 1/V Σ r^y F^y over the contacts
        stress_yy: "Pa",
        /// 1/V Σ r^z F^z over the contacts; NaN in 2D
        stress_zz: "Pa",
    }
}

gshear_dem::columns! {
    /// What a row of the time series of strain steps has besides, where they follow a protocol.
    pub struct StrainProtocolRow {
        /// number of the part, from 1; 0 before the first strain step
        part: "1",
        /// γ of the images above
        shear_strain: "1",
        /// -ln(L_x/L_x,0) with L_x,0 before the first strain step: compression is positive
        strain_xx: "1",
        /// -ln(L_y/L_y,0)
        strain_yy: "1",
        /// -ln(L_z/L_z,0); NaN in 2D
        strain_zz: "1",
        /// -ln(V/V_0), the sum of these
        volume_strain: "1",
    }
}

/// The columns of the time series of strain steps, of a protocol or of another deformation.
pub fn strain_columns(is_protocol: bool) -> &'static [Column] {
    static OF_PROTOCOL: LazyLock<Vec<Column>> =
        LazyLock::new(|| [&AqsRow::COLUMNS[..], &StrainProtocolRow::COLUMNS].concat());
    if is_protocol {
        &OF_PROTOCOL
    } else {
        &AqsRow::COLUMNS
    }
}

gshear_dem::columns! {
    /// One row of the time series of Newton's equations.
    pub struct NewtonianRow {
        /// mean square displacement M(t) (BO 10)
        msd: "m2",
        /// of all grains, translation and rotation
        kinetic_energy: "J",
        /// energy stored in the contacts
        elastic_energy: "J",
        /// as of the strain steps
        shear_stress: "Pa",
        /// 1/(dV) Σ r·F over the contacts, in d dimensions
        pressure: "Pa",
        /// number of contacts
        contacts: "1",
        /// sliding contacts over all contacts
        sliding_fraction: "1",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gshear_analysis::frame_scalars::FrameScalars;
    use gshear_dem::profile::RankProfile;
    use gshear_dem::state::{
        BottomRow, FlowRow, ImposedRow, LateralRow, SeriesRow, StressRow, TemperatureRow,
    };
    use std::collections::BTreeSet;
    use std::fmt::Write as _;

    const TABLES: [(&str, &[Column]); 12] = [
        ("SeriesRow", &SeriesRow::COLUMNS),
        ("ImposedRow", &ImposedRow::COLUMNS),
        ("BottomRow", &BottomRow::COLUMNS),
        ("StressRow", &StressRow::COLUMNS),
        ("LateralRow", &LateralRow::COLUMNS),
        ("FlowRow", &FlowRow::COLUMNS),
        ("TemperatureRow", &TemperatureRow::COLUMNS),
        ("FrameScalars", &FrameScalars::COLUMNS),
        ("AqsRow", &AqsRow::COLUMNS),
        ("StrainProtocolRow", &StrainProtocolRow::COLUMNS),
        ("NewtonianRow", &NewtonianRow::COLUMNS),
        ("RankProfile", &RankProfile::COLUMNS),
    ];
    const PAGE: &str = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../docs/reference/columns.md"
    );

    fn table(columns: &[Column]) -> String {
        let mut text = String::from("| column | unit | content |\n| --- | --- | --- |\n");
        for Column {
            name, unit, doc, ..
        } in columns
        {
            let unit = match *unit {
                "1" => "",
                "m s-1" => "m/s",
                "m2" => "m²",
                "m2 s-2" => "m²/s²",
                "s-2" => "1/s²",
                unit => unit,
            };
            let doc = doc.replace('|', "\\|");
            let row = format!("| `{name}` | {unit} | {doc} |").replace("|  |", "| |");
            let length = row.chars().count();
            assert!(length <= 100, "longer than a line of the page: {row}");
            writeln!(text, "{row}").unwrap();
        }
        text
    }

    /// The page with the declared tables between its marks.
    fn with_tables(page: &str) -> String {
        let mut page = page.to_string();
        for (name, columns) in TABLES {
            let mark = format!("<!-- columns of {name} -->\n");
            let begin = page.find(&mark);
            let begin = begin.unwrap_or_else(|| panic!("{mark} is missing")) + mark.len();
            let end = page[begin..].find("<!-- end of columns -->");
            let end = begin + end.expect("the end of the columns");
            page.replace_range(begin..end, &format!("\n{}\n", table(columns)));
        }
        page
    }

    #[test]
    fn docs_have_the_declared_columns() {
        let page = std::fs::read_to_string(PAGE).unwrap();
        assert!(
            with_tables(&page) == page,
            "docs/reference/columns.md does not have the declared columns; write them with\n  \
             cargo test --release -p gshear-store --lib -- --ignored write_columns_to_docs"
        );
    }

    #[test]
    #[ignore = "writes docs/reference/columns.md"]
    fn write_columns_to_docs() {
        let page = std::fs::read_to_string(PAGE).unwrap();
        std::fs::write(PAGE, with_tables(&page)).unwrap();
    }

    #[test]
    fn names_are_unique() {
        for (table, columns) in TABLES {
            let names: BTreeSet<_> = columns.iter().map(|column| column.name).collect();
            assert_eq!(names.len(), columns.len(), "{table}: {names:?}");
        }
    }
}
