//! What the files of a run say about it: its identity, where it branched off, how it was resumed.

use serde::{Deserialize, Serialize};

use gshear_scene::Scene;
use gshear_scene::identity::{hash, identity};
use gshear_store::h5::Attribute;

/// The identity of a run and its history.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunRecord {
    /// The identity: [`identity`](identity()) of the scene with which the run began; of a branch,
    /// a hash of that and of the checkpoint.
    pub id: String,
    /// The checkpoint from which the run branched off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parent: Option<Parent>,
    /// Every resume so far.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub resumed: Vec<Continuation>,
    /// Settings of speed that earlier builds tried and kept: not used.
    #[serde(default, skip_serializing)]
    tuned: Option<serde_json::Value>,
}

/// The checkpoint from which a branch begins.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parent {
    /// Identity of the run that wrote it.
    pub id: String,
    /// Where the branch begins, and with which changes.
    pub at: Continuation,
}

/// A resume: the checkpoint's stage and step, and the values that it changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Continuation {
    /// Name of the stage.
    pub stage: String,
    /// Completed steps of the stage.
    pub step: u64,
    /// `shear.strain from 0.1 to 0.2`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<String>,
}

impl std::fmt::Display for Continuation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} step {}", self.stage, self.step)?;
        if self.changes.is_empty() {
            Ok(())
        } else {
            write!(f, ": {}", self.changes.join(", "))
        }
    }
}

impl RunRecord {
    /// The record of a run from its first grain.
    pub fn new(scene: &Scene) -> Self {
        Self {
            id: identity(scene),
            parent: None,
            resumed: Vec::new(),
            tuned: None,
        }
    }

    /// The record of a branch of this run, with this scene.
    pub fn branch(&self, scene: &Scene, at: Continuation) -> Self {
        let Continuation { stage, step, .. } = &at;
        let text = format!("{} from {} {stage} {step}", identity(scene), self.id);
        Self {
            id: hash(text.as_bytes()),
            parent: Some(Parent {
                id: self.id.clone(),
                at,
            }),
            resumed: Vec::new(),
            tuned: None,
        }
    }

    /// Attributes of `parameters` in the files of the run.
    pub fn attributes(&self) -> Vec<(&'static str, Attribute)> {
        let mut attributes = vec![("run_id", Attribute::Text(self.id.clone()))];
        if let Some(Parent { id, at }) = &self.parent {
            attributes.extend([
                ("parent_run_id", Attribute::Text(id.clone())),
                ("branched_from", Attribute::Text(at.to_string())),
            ]);
        }
        if !self.resumed.is_empty() {
            let lines: Vec<String> = self.resumed.iter().map(ToString::to_string).collect();
            attributes.push(("resumed", Attribute::Text(lines.join("\n"))));
        }
        attributes
    }

    /// The record as comments at the top of `scene.toml`.
    pub fn comments(&self) -> String {
        let mut text = format!("{ID_COMMENT}{}\n", self.id);
        if let Some(Parent { id, at }) = &self.parent {
            text += &format!("{BRANCH_COMMENT}{id}, from {at}\n");
        }
        for at in &self.resumed {
            text += &format!("# resumed at {at}\n");
        }
        text
    }
}

/// Begins the line of `scene.toml` with the identity of the run.
const ID_COMMENT: &str = "# run_id ";

/// Begins the line of the `scene.toml` of a branch.
const BRANCH_COMMENT: &str = "# branch of ";

/// Returns the identity in a `scene.toml`, if it has one.
pub(crate) fn id_in_scene(toml: &str) -> Option<&str> {
    toml.lines().find_map(|line| line.strip_prefix(ID_COMMENT))
}

/// Whether a `scene.toml` is that of a branch.
pub(crate) fn is_branch_in_scene(toml: &str) -> bool {
    toml.lines().any(|line| line.starts_with(BRANCH_COMMENT))
}
