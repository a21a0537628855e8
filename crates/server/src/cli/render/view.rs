//! The camera on the command line: one of the scene's, or one's own.

use super::surroundings::parse_three;
use clap::Args;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{CameraChoice, ExplicitCamera};
use hemilux_engine::scene::Scene;

/// Which camera takes the picture.
#[derive(Args)]
pub struct View {
    /// The camera, by name or index; the scene's first by default.
    #[arg(long, value_name = "NAME|INDEX", conflicts_with = "eye")]
    camera: Option<String>,
    /// A camera of one's own: where it is, metres.
    #[arg(long, value_name = "X,Y,Z", requires = "target", allow_hyphen_values = true, value_parser = parse_three)]
    eye: Option<Rgb>,
    /// The point that it looks at.
    #[arg(long, value_name = "X,Y,Z", requires = "eye", allow_hyphen_values = true, value_parser = parse_three)]
    target: Option<Rgb>,
    /// Which way is up for it.
    #[arg(long, value_name = "X,Y,Z", requires = "eye", allow_hyphen_values = true, value_parser = parse_three, default_value = "0,1,0")]
    up: Rgb,
    /// Its full vertical field of view.
    #[arg(long, value_name = "DEGREES", requires = "eye", default_value_t = 40.0)]
    yfov: f32,
}

impl View {
    /// The camera in a scene's terms.
    pub fn camera(&self, scene: &Scene) -> CameraChoice {
        let (Some(eye), Some(target)) = (self.eye, self.target) else {
            return camera_choice(self.camera.as_deref(), scene);
        };
        CameraChoice::Explicit(ExplicitCamera {
            eye: eye.to_array(),
            target: target.to_array(),
            up: self.up.to_array(),
            yfov_degrees: self.yfov,
        })
    }
}

/// A camera's name goes before its index, so that a camera named "2" can be chosen.
pub fn camera_choice(word: Option<&str>, scene: &Scene) -> CameraChoice {
    let Some(word) = word else { return CameraChoice::First };
    let is_name = scene.cameras.iter().any(|camera| camera.name == word);
    match word.parse::<u32>() {
        Ok(index) if !is_name => CameraChoice::Index(index),
        _ => CameraChoice::Name(word.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        view: View,
    }

    fn camera(words: &[&str]) -> Option<CameraChoice> {
        let words = ["hemilux"].iter().chain(words);
        Command::try_parse_from(words).ok().map(|command| command.view.camera(&Scene::default()))
    }

    #[test]
    fn cameras_are_the_scenes_or_ones_own() {
        assert_eq!(camera(&[]), Some(CameraChoice::First));
        assert_eq!(camera(&["--camera", "2"]), Some(CameraChoice::Index(2)));
        let own = ExplicitCamera {
            eye: [-1.0, 2.0, 3.5],
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            yfov_degrees: 40.0,
        };
        let place = ["--eye", "-1,2,3.5", "--target", "0,0,0"];
        assert_eq!(camera(&place), Some(CameraChoice::Explicit(own)));
        let turned = ExplicitCamera { up: [0.0, 0.0, -1.0], yfov_degrees: 25.0, ..own };
        let more = [&place[..], &["--up", "0,0,-1", "--yfov", "25"]].concat();
        assert_eq!(camera(&more), Some(CameraChoice::Explicit(turned)));
        for words in
            [&place[..2], &place[2..], &["--yfov", "20"], &["--eye", "1,2", "--target", "0,0,0"]]
        {
            assert_eq!(camera(words), None, "{words:?}");
        }
        assert_eq!(camera(&[&place[..], &["--camera", "a"]].concat()), None);
    }
}
