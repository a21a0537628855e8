//! Whether the file of a job's scene has what the job wants to show of it.

use super::jobs::JobRequest;
use super::parts::{MAX_PART_CHARS, PartRequest};
use super::scenes::Scene;
use serde::Serialize;

/// What a job shows of its scene's file, in the same words whichever way it is asked for: the
/// places of the scene and of the animation, and the time.
#[derive(Serialize)]
pub struct ShownParts {
    gltf_scene: Option<PartRequest>,
    animation: Option<PartRequest>,
    time: Option<f64>,
}

fn names_of_animations(scene: &Scene) -> Option<Vec<Option<&str>>> {
    let animations = scene.animations.as_ref()?;
    Some(animations.iter().map(|animation| animation.name.as_deref()).collect())
}

fn names_of_scenes(scene: &Scene) -> Option<Vec<Option<&str>>> {
    let scenes = scene.gltf_scenes.as_ref()?;
    Some(scenes.iter().map(|scene| scene.name.as_deref()).collect())
}

impl JobRequest {
    /// What is wrong with the choice of a scene, an animation and a time, whatever the file has.
    pub(super) fn part_problems(&self, wrong: &mut impl FnMut(&str, String)) {
        for (field, part) in [("gltf_scene", &self.gltf_scene), ("animation", &self.animation)] {
            if let Some(PartRequest::Name(name)) = part
                && name.chars().count() > MAX_PART_CHARS
            {
                wrong(field, format!("at most {MAX_PART_CHARS} characters"));
            }
        }
        let Some(time) = self.time else { return };
        if !(time.is_finite() && time >= 0.0) {
            wrong("time", format!("must be finite and not negative, is {time}"));
        } else if self.animation.is_none() {
            wrong("time", "is a moment of an animation; choose one as `animation`".into());
        }
    }

    /// Whether a scene's file has the animation and the scene that are asked for: the field and
    /// the message if not. Of scenes that an earlier release stored it is not known: then the
    /// import says.
    pub fn part_problem(&self, scene: &Scene) -> Option<(&'static str, String)> {
        let asked = [
            ("gltf_scene", "scene", &self.gltf_scene, names_of_scenes(scene)),
            ("animation", "animation", &self.animation, names_of_animations(scene)),
        ];
        asked.into_iter().find_map(|(field, what, part, names)| {
            Some((field, part.as_ref()?.problem(what, &names?)?))
        })
    }

    /// What of its scene's file it shows.
    pub fn shown_parts(&self, scene: &Scene) -> ShownParts {
        let at = |part: &Option<PartRequest>, names: Option<Vec<Option<&str>>>| {
            let part = part.as_ref()?;
            let position = names.and_then(|names| part.position(&names));
            Some(position.map_or_else(|| part.clone(), PartRequest::Index))
        };
        ShownParts {
            gltf_scene: at(&self.gltf_scene, names_of_scenes(scene)),
            animation: at(&self.animation, names_of_animations(scene)),
            time: self.animation.as_ref().map(|_| self.time.unwrap_or(0.0)),
        }
    }
}
