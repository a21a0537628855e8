//! Extensions that change what is shown of a file, or nothing of it, and places on the globe.

use super::{close, square};
use glam::Vec3;
use serde_json::{Value, json};

/// The names of extensions in a file that uses and requires them, and what it warns of.
fn warnings_of(names: &[&str]) -> Result<Vec<String>, String> {
    let mut file = square();
    file.root["extensionsUsed"] = json!(names);
    file.root["extensionsRequired"] = json!(names);
    let scene = super::import_bytes(&file.glb()).map_err(|error| error.to_string())?;
    assert_eq!(scene.triangles.len(), 2);
    Ok(scene.warnings.into_iter().map(|warning| warning.what).collect())
}

#[test]
fn what_no_picture_shows_may_be_required() {
    let unseen = [
        "KHR_interactivity",
        "EXT_structural_metadata",
        "EXT_mesh_features",
        "KHR_xmp_json_ld",
        "VRM",
        "MOZ_hubs_components",
    ];
    assert_eq!(warnings_of(&unseen), Ok(Vec::new()));
}

#[test]
fn what_is_left_out_of_a_file_is_said_once() {
    let warnings = warnings_of(&["CESIUM_RTC", "KHR_gaussian_splatting"]).unwrap();
    assert_eq!(warnings.len(), 2);
    assert!(warnings[0].starts_with("CESIUM_RTC: the scene stands"), "{warnings:?}");
    assert!(warnings[1].starts_with("KHR_gaussian_splatting: splats"), "{warnings:?}");
}

#[test]
fn what_cannot_be_shown_is_refused_with_what_to_do() {
    let refusal = warnings_of(&["KHR_techniques_webgl"]).unwrap_err();
    assert!(refusal.contains("extensionsRequired[0]") && refusal.contains("metallic-roughness"));
    let refusal = warnings_of(&["KHR_interactivity", "EXT_of_tomorrow"]).unwrap_err();
    assert!(refusal.contains("extensionsRequired[1]") && refusal.contains("EXT_of_tomorrow"));
}

/// A root with a mesh, below it a node with a light, a camera and a mesh, and one more mesh.
fn family(hidden: &[(usize, Value)]) -> super::File {
    let mut file = square();
    file.root["scenes"] = json!([{ "nodes": [0, 2] }]);
    file.root["nodes"] = json!([
        { "mesh": 0, "children": [1] },
        { "mesh": 0, "camera": 0, "extensions": { "KHR_lights_punctual": { "light": 0 } } },
        { "mesh": 0 },
    ]);
    file.root["cameras"] =
        json!([{ "type": "perspective", "perspective": { "yfov": 1, "znear": 1 } }]);
    file.root["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point" }] } });
    file.root["extensionsUsed"] = json!(["KHR_node_visibility", "KHR_lights_punctual"]);
    for (node, visible) in hidden {
        file.root["nodes"][node]["extensions"]["KHR_node_visibility"] =
            json!({ "visible": visible });
    }
    file
}

#[test]
fn hidden_nodes_hide_all_below_them_but_cameras() {
    let no = || json!(false);
    for (hidden, triangles, lights) in [
        (vec![], 6, 1),
        (vec![(0, json!(true))], 6, 1),
        (vec![(0, no())], 2, 0),
        (vec![(0, no()), (1, json!(true))], 2, 0),
        (vec![(1, no())], 4, 0),
        (vec![(2, no())], 4, 1),
    ] {
        let scene = family(&hidden).import();
        let shown = (scene.triangles.len(), scene.lights.len(), scene.cameras.len());
        assert_eq!(shown, (triangles, lights, 1), "{hidden:?}");
        assert_eq!(scene.warnings, []);
    }
    let refusal = super::import_bytes(&family(&[(1, json!("no"))]).glb()).unwrap_err();
    assert_eq!(refusal.at, "nodes[1].extensions.KHR_node_visibility.visible");
}

/// A family that stands on the globe: its places there have steps of half a metre.
#[test]
fn what_stands_on_the_globe_is_moved_to_the_origin() {
    let of = |x: f64, y: f64, others: &[usize]| {
        let mut file = family(&[]);
        file.root["nodes"][0]["translation"] = json!([x + 0.5, y, 0]);
        file.root["nodes"][1]["translation"] = json!([0, 0, 3]);
        for node in others {
            file.root["nodes"][node]["translation"] = json!([x + 1.0, y, 0]);
        }
        file.import()
    };
    let scene = of(4_327_888.0, -4_608_578.0, &[2]);
    let said = &scene.warnings[0];
    assert_eq!((scene.warnings.len(), said.at.as_str()), (1, "nodes"));
    assert!(said.what.contains("moved by (-4328000, 4609000, 0)"), "{said:?}");
    let eye = scene.cameras[0].to_world.w_axis.truncate();
    assert!(close(eye, Vec3::new(-111.5, 422.0, 3.0)), "{eye}");
    assert!(close(scene.lights[0].position, eye));
    let first = scene.vertices[0].position;
    assert!(close(first, Vec3::new(-111.5, 422.0, 0.0)), "{first}");
    // Nearer ones stay, as do those of which a part is at the origin.
    for stays in [of(40_000.0, 300.0, &[2]), of(4_327_888.0, 0.0, &[])] {
        assert!(stays.warnings.iter().all(|warning| warning.at != "nodes"));
        assert!(stays.cameras[0].to_world.w_axis.x > 39_999.0);
    }
}
