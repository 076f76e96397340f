//! Commented scenes to start from.

/// A scene to start from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Template {
    /// Its name, such as `walls-2d`.
    pub name: &'static str,
    /// What it is, in a few words.
    pub summary: &'static str,
    /// The configuration.
    pub text: &'static str,
}

/// A template of this name, whose text is the file of the name in `templates/`.
macro_rules! template {
    ($name:literal, $summary:literal) => {
        Template {
            name: $name,
            summary: $summary,
            text: include_str!(concat!("../templates/", $name, ".toml")),
        }
    };
}

/// All of them.
pub const TEMPLATES: [Template; 7] = [
    template!("walls-2d", "disks sheared between rough walls"),
    template!("walls-3d", "spheres sheared between rough walls"),
    template!("periodic", "disks that flow without walls"),
    template!("chute", "disks that flow down a slope"),
    template!("slider", "gouge under a spring slider"),
    template!("quasi-static", "strain steps of a periodic packing"),
    template!("cohesive", "disks that attract each other"),
];

/// The template of a name.
pub fn template(name: &str) -> Option<&'static Template> {
    TEMPLATES.iter().find(|template| template.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Source, load};

    #[test]
    fn every_template_is_a_sound_scene() {
        for template in TEMPLATES {
            let source = Source::new(template.name, template.text);
            load(&source, &[]).expect("a sound scene");
            let has_long_lines = template.text.lines().any(|line| line.chars().count() > 100);
            assert!(!has_long_lines, "{}", template.name);
        }
    }
}
