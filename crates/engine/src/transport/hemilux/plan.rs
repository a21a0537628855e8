//! Why the tiers run as they do, in words.

use super::settings::HemiluxSettings;
use crate::emitters::MOST_LIGHTS;
use crate::scene::Scene;

/// One sentence a decision.
pub fn reasons(scene: &Scene, options: &HemiluxSettings) -> Vec<String> {
    let glossy = scene.materials.iter().zip(scene.used_materials()).any(|(material, used)| {
        used && material.reflectance(&material.typical(material.base_color)).is_glossy()
    });
    let emitters = scene.emissive_triangles();
    let mut reasons = Vec::new();
    reasons.push("tier 1: links solve the coarse mesh on the processor; hemicube shots take longer for the same error".into());
    reasons.push(match (options.gather, options.gather_direct) {
        (true, true) => "tier 2: indirect light is gathered at records on what the camera sees, with fresh direct light where the rays end".into(),
        (true, false) => "tier 2: indirect light is gathered at records on what the camera sees".into(),
        (false, _) => "tier 2 is off: indirect light is shown as the coarse mesh has it".into(),
    });
    reasons.push(match (options.light, emitters <= MOST_LIGHTS) {
        (true, true) => format!("tier 3: {emitters} emissive triangles, so direct light is in closed form but for what is in between"),
        (true, false) => format!("tier 3: {emitters} emissive triangles, so direct light is sampled where they are more than {MOST_LIGHTS} polygons"),
        (false, _) => "tier 3 is off: direct light is shown as the coarse mesh has it".into(),
    });
    reasons.push(if glossy {
        "glossy surfaces: their lobes are traced per pixel".into()
    } else {
        "all surfaces are diffuse: no lobes are traced".into()
    });
    reasons
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use crate::transport::hemilux::Hemilux;
    use crate::transport::options::Settings;
    use crate::transport::solver::Method;

    #[test]
    fn the_plan_names_what_the_scene_has_and_what_is_switched_off() {
        let reasons = |glb: &[u8], given: &[(&str, &str)]| {
            let scene = import(glb, &Resources::new(), &ImportLimits::default()).expect("valid");
            let given = given.iter().map(|(name, value)| (name.to_string(), value.to_string()));
            let settings = Settings::new(&Hemilux.scope(), &given.collect()).expect("right");
            super::reasons(&scene, &HemiluxSettings::new(&settings, 16)).join("; ")
        };
        let plain = reasons(&made::cornell(), &[]);
        assert!(plain.contains("all surfaces are diffuse") && plain.contains("closed form"));
        assert!(reasons(&made::phong_cornell(), &[]).contains("lobes are traced"));
        let off = reasons(&made::cornell(), &[("gather", "false"), ("light", "false")]);
        assert!(off.contains("tier 2 is off") && off.contains("tier 3 is off"), "{off}");
    }
}
