//! The dashboard: static files, part of the program, and the few facts about this server that the
//! page cannot learn from the API.

use super::app::App;
use crate::api::settings::Setting;
use crate::builtin;
use crate::worker;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Json, Router};
use serde::Serialize;

/// Only files of this server run and style the page; nothing may frame it. Snapshots are ordinary
/// files of this server, or what a script fetched with a key (`blob:`).
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const SVG: &str = "image/svg+xml";

/// A file of the page: path, media type, content.
macro_rules! page_file {
    ($path:literal, $media_type:expr, $file:literal) => {
        ($path, $media_type, include_bytes!(concat!("../dashboard/", $file)) as &[u8])
    };
}

const FILES: &[(&str, &str, &[u8])] = &[
    page_file!("/", HTML, "index.html"),
    page_file!("/assets/style.css", STYLE, "style.css"),
    page_file!("/assets/icon.svg", SVG, "icon.svg"),
    page_file!("/assets/app.js", SCRIPT, "app.js"),
    page_file!("/assets/api.js", SCRIPT, "api.js"),
    page_file!("/assets/chart.js", SCRIPT, "chart.js"),
    page_file!("/assets/dom.js", SCRIPT, "dom.js"),
    page_file!("/assets/field.js", SCRIPT, "field.js"),
    page_file!("/assets/follow.js", SCRIPT, "follow.js"),
    page_file!("/assets/format.js", SCRIPT, "format.js"),
    page_file!("/assets/form.js", SCRIPT, "form.js"),
    page_file!("/assets/header.js", SCRIPT, "header.js"),
    page_file!("/assets/job.js", SCRIPT, "job.js"),
    page_file!("/assets/key.js", SCRIPT, "key.js"),
    page_file!("/assets/list.js", SCRIPT, "list.js"),
    page_file!("/assets/picture.js", SCRIPT, "picture.js"),
    page_file!("/assets/settings.js", SCRIPT, "settings.js"),
    page_file!("/assets/welcome.js", SCRIPT, "welcome.js"),
];

/// `/` and `/assets/…`.
pub fn pages() -> Router<App> {
    FILES
        .iter()
        .fold(Router::new(), |router, &(path, media_type, bytes)| {
            router.route(path, get(move || async move { file(media_type, bytes) }))
        })
        .route("/assets/server.json", get(about))
}

fn file(media_type: &'static str, bytes: &'static [u8]) -> Response {
    let headers = [
        (header::CONTENT_TYPE, media_type),
        (header::CACHE_CONTROL, "no-cache"),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ];
    (headers, bytes).into_response()
}

/// What the form for a new job offers. Serves the page only: clients of the API learn the same
/// from its answers.
#[derive(Serialize)]
struct About {
    version: &'static str,
    methods: &'static [&'static str],
    settings: Vec<Setting>,
    builtin_scenes: Vec<&'static str>,
    max_side: u32,
    max_seconds: f64,
    max_upload_mb: u64,
}

async fn about(State(app): State<App>) -> impl IntoResponse {
    let about = About {
        version: env!("CARGO_PKG_VERSION"),
        methods: worker::METHODS,
        settings: worker::public_settings().collect(),
        builtin_scenes: builtin::names(),
        max_side: app.shared.config.max_side,
        max_seconds: app.shared.config.max_seconds,
        max_upload_mb: app.shared.config.max_upload_mb,
    };
    ([(header::CACHE_CONTROL, "no-cache")], Json(about))
}

#[cfg(test)]
mod tests {
    use super::{FILES, SCRIPT};
    use std::path::Path;

    /// What stands between double quotes in an import or in the page and names an asset.
    fn named_assets(text: &str) -> impl Iterator<Item = String> {
        text.split('"').filter_map(|word| {
            let name = word.strip_prefix("./").or_else(|| word.strip_prefix("/assets/"))?;
            name.contains('.').then(|| format!("/assets/{name}"))
        })
    }

    #[test]
    fn every_file_that_the_page_names_is_served_and_every_file_is_named() {
        let served: Vec<_> = FILES.iter().map(|(path, ..)| (*path).to_owned()).collect();
        let texts = FILES.iter().map(|(_, _, bytes)| std::str::from_utf8(bytes).unwrap());
        let named: Vec<_> = texts.flat_map(named_assets).collect();
        for path in &named {
            assert!(served.contains(path) || path == "/assets/server.json", "{path} is not served");
        }
        for path in served.iter().filter(|path| *path != "/") {
            assert!(named.contains(path), "nothing names {path}");
        }
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/dashboard");
        assert_eq!(std::fs::read_dir(folder).unwrap().count(), FILES.len());
    }

    #[test]
    fn the_page_needs_nothing_that_its_policy_forbids() {
        let page = std::str::from_utf8(FILES[0].2).unwrap();
        for inline in ["<style", "style=", "onclick=", "javascript:"] {
            assert!(!page.contains(inline), "{inline}");
        }
        for (path, _, bytes) in FILES.iter().filter(|(_, media_type, _)| *media_type == SCRIPT) {
            let text = std::str::from_utf8(bytes).unwrap();
            // Text of users goes in as text nodes only.
            for way_in in
                ["innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval("]
            {
                assert!(!text.contains(way_in), "{path} uses {way_in}");
            }
        }
    }
}
