//! No number of a scene is so large or so small that it is taken and overflows later: for every key
//! of the schema that takes one.

use gshear_dem::failure::Failure;
use gshear_scene::{Source, load};
use serde_json::Value;

use crate::common::crossing::SCENE;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// The paths of all keys below a table of the schema that take a number; of a list of tables, such
/// as the parts of a protocol, a value for the whole list in which `{}` stands for the number.
fn numbers(table: &str, keys: &Value, found: &mut Vec<String>) {
    for (name, schema) in keys.as_object().expect("keys") {
        let path = match table {
            "" => name.clone(),
            table => format!("{table}.{name}"),
        };
        let takes = |schema: &Value, kind: &str| match &schema["type"] {
            Value::Array(kinds) => kinds.iter().any(|of| of == kind),
            of => of == kind,
        };
        let items = &schema["items"];
        if takes(schema, "number") {
            found.push(format!("{path}={{}}"));
        } else if takes(items, "number") {
            found.push(format!("{path}=[{{}}]"));
        } else if let Some(keys) = items["properties"]
            .as_object()
            .filter(|_| !table.is_empty())
        {
            for (key, _) in keys.iter().filter(|(_, of)| takes(of, "number")) {
                found.push(path.clone() + "=[{ " + key + " = {} }]");
            }
        }
        if let (Some(inner), true) = (schema.get("properties"), table.is_empty()) {
            numbers(name, inner, found);
        }
    }
}

/// Each is refused by one message; numbers at the ends of the range are taken or refused.
#[test]
fn huge_and_tiny_numbers_are_refused_of_every_key() {
    let schema = std::fs::read_to_string(format!("{ROOT}/docs/scene.schema.json"));
    let schema: Value = serde_json::from_str(&schema.expect("a schema")).expect("JSON");
    let mut sets = Vec::new();
    numbers("", &schema["properties"], &mut sets);
    for needed in [
        "load.gravity={}",
        "contact.friction={}",
        "relax.drag={}",
        "aqs.pressures=[{}]",
    ] {
        assert!(
            sets.iter().any(|set| set == needed),
            "no {needed} in {sets:?}"
        );
    }
    assert!(sets.len() > 90, "{}", sets.len());
    let scenes = [
        SCENE.to_string(),
        format!("{ROOT}/tests/scenes/periodic.toml"),
    ];
    for scene in scenes {
        let source = Source::read(&scene).expect("a scene");
        let mut in_magnitude = 0;
        for set in &sets {
            let at = |number: &str| load(&source, &[set.replace("{}", number)]);
            for number in ["1e300", "-1e300", "1e-300", "-1e-300"] {
                match at(number) {
                    Err(Failure::Input(message)) => {
                        assert_eq!(message.lines().count(), 1, "{message}");
                        in_magnitude += u32::from(message.contains("in magnitude"));
                    }
                    other => panic!(
                        "{scene}: {set} with {number}: {:?}",
                        other.map(|of| of.toml)
                    ),
                }
            }
            for number in ["1e30", "-1e30", "1e-30"] {
                if let Err(failure) = at(number) {
                    assert!(
                        matches!(failure, Failure::Input(_)),
                        "{set} {number}: {failure:?}"
                    );
                }
            }
        }
        assert!(in_magnitude > 20, "{scene}: {in_magnitude}");
    }
}
