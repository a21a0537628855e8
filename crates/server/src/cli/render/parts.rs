//! What of a scene's file is shown: one of its scenes, moved by one of its animations.

use clap::Args;
use hemilux_engine::scene::gltf::{Choice, ImportOptions};

/// Which of a file's scenes and animations.
#[derive(Args)]
pub struct Parts {
    /// The scene in the file, by name or index; the file's default one, or else its first, without.
    #[arg(long = "scene", value_name = "NAME|INDEX", value_parser = parse_part)]
    gltf_scene: Option<Choice>,
    /// The animation that moves it, by name or index; without one it is shown at rest.
    #[arg(long, value_name = "NAME|INDEX", value_parser = parse_part)]
    animation: Option<Choice>,
    /// The moment of the animation.
    #[arg(long, value_name = "SECONDS", requires = "animation", allow_hyphen_values = true, default_value = "0", value_parser = parse_moment)]
    time: f64,
}

impl Parts {
    /// What an import is asked for.
    pub fn options(&self, variant: Option<String>) -> ImportOptions {
        ImportOptions {
            variant,
            scene: self.gltf_scene.clone(),
            animation: self.animation.clone(),
            time: self.time,
            ..ImportOptions::default()
        }
    }
}

/// A name or an index; which of both, the file decides.
fn parse_part(word: &str) -> Result<Choice, std::convert::Infallible> {
    Ok(Choice::Word(word.to_owned()))
}

fn parse_moment(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(seconds) if seconds.is_finite() && seconds >= 0.0 => Ok(seconds),
        _ => Err("must be a number of seconds that is not negative".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        parts: Parts,
    }

    fn options(words: &[&str]) -> Option<(Option<Choice>, Option<Choice>, f64)> {
        let words = ["hemilux"].iter().chain(words);
        let options = Command::try_parse_from(words).ok()?.parts.options(None);
        Some((options.scene, options.animation, options.time))
    }

    #[test]
    fn moments_belong_to_animations() {
        let word = |word: &str| Some(Choice::Word(word.into()));
        assert_eq!(options(&[]), Some((None, None, 0.0)));
        let all = ["--scene", "night", "--animation", "2", "--time", "1.25"];
        assert_eq!(options(&all), Some((word("night"), word("2"), 1.25)));
        assert_eq!(options(&["--animation", "walk"]), Some((None, word("walk"), 0.0)));
        for time in ["-1", "NaN", "inf", "soon"] {
            assert_eq!(options(&["--animation", "walk", "--time", time]), None, "{time}");
        }
        assert_eq!(options(&["--time", "1"]), None, "a moment of what?");
    }
}
