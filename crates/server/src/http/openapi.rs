//! The API's description, written from the handlers themselves.

use super::problem::{MEDIA_TYPE, ProblemDocument};
use crate::api::environment::MapOfSky;
use crate::api::events::{NoticeEvent, ProgressEvent, SnapshotEvent, StateEvent};
use crate::api::jobs::{ExplicitCamera, OptionValue};
use crate::worker;
use serde_json::json;
use std::collections::BTreeMap;
use utoipa::OpenApi;
use utoipa::openapi::path::Parameter;
use utoipa::openapi::schema::{
    AdditionalProperties, KnownFormat, ObjectBuilder, Schema, SchemaFormat, SchemaType, Type,
};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Ref, RefOr, Response};

#[derive(OpenApi)]
#[openapi(
    info(
        title = "Hemilux",
        description = "Global illumination as a service: post a glTF scene, ask for a picture, watch it converge.\n\nEvery error is a problem document (RFC 9457).",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    servers((url = "/")),
    tags(
        (name = "scenes", description = "What there is to light."),
        (name = "environments", description = "Maps of skies to light it with."),
        (name = "jobs", description = "Pictures to compute."),
        (name = "results", description = "Pictures and figures."),
        (name = "operations", description = "Running the service."),
    ),
    components(schemas(ProblemDocument, ExplicitCamera, MapOfSky, OptionValue, StateEvent, ProgressEvent, SnapshotEvent, NoticeEvent))
)]
struct Base;

/// Everything but the paths.
pub fn base() -> utoipa::openapi::OpenApi {
    Base::openapi()
}

/// Completes a description that has the paths as the handlers say them.
fn complete(mut document: utoipa::openapi::OpenApi) -> utoipa::openapi::OpenApi {
    for (path, item) in &mut document.paths.paths {
        let is_closed = path.starts_with("/v1/");
        let operations = [&mut item.get, &mut item.post, &mut item.delete]
            .into_iter()
            .filter_map(Option::as_mut);
        for operation in operations {
            operation.parameters.iter_mut().flatten().for_each(leave_out_rather_than_null);
            let responses = &mut operation.responses.responses;
            if is_closed {
                // Either of them: a server without keys asks for none.
                operation.security = Some(vec![
                    SecurityRequirement::default(),
                    SecurityRequirement::new("api_key", Vec::<String>::new()),
                ]);
                for (status, text) in [
                    ("401", "The server asks for an API key, and there is none or a wrong one."),
                    ("429", "A limit of this caller is reached; see `limit` and Retry-After."),
                ] {
                    let answer = || RefOr::T(problem(text));
                    responses.entry(status.into()).or_insert_with(answer);
                }
            }
            for (status, text) in [
                (
                    "403",
                    "A page of another site sent the request, the Host header is foreign, or the API key lacks a scope.",
                ),
                ("500", "A fault of the server; its log has more."),
                ("503", "Not now; see Retry-After."),
            ] {
                responses.insert(status.into(), RefOr::T(problem(text)));
            }
            for (status, response) in responses.iter_mut() {
                if let RefOr::T(response) = response {
                    add_example(status, response);
                }
            }
        }
    }
    document.components.get_or_insert_default().security_schemes.insert(
        "api_key".into(),
        RefOr::T(SecurityScheme::Http(
            HttpBuilder::new()
                .scheme(HttpAuthScheme::Bearer)
                .description(Some(
                    "An API key, `hmx_…`, as `hemilux keys add` makes them. A server without keys asks for none.",
                ))
                .build(),
        )),
    );
    describe_resources(&mut document, "SceneFiles");
    describe_resources(&mut document, "JobWithScene");
    name_the_vocabulary(&mut document);
    document
}

/// The whole description as YAML, of one that has the paths as the handlers say them.
pub fn yaml(document: utoipa::openapi::OpenApi) -> String {
    complete(document).to_yaml().expect("the API's description serialises")
}

fn problem(text: &str) -> Response {
    let schema = RefOr::Ref(Ref::from_schema_name("ProblemDocument"));
    utoipa::openapi::ResponseBuilder::new()
        .description(text)
        .content(MEDIA_TYPE, utoipa::openapi::ContentBuilder::new().schema(Some(schema)).build())
        .build()
}

/// An example of the problem behind a status: its kind, its title and what it may say.
fn example_of(status: &str) -> Option<(&'static str, &'static str, &'static str)> {
    Some(match status {
        "400" => {
            ("unreadable", "The request cannot be read", "limit must be between 1 and 200, is 0")
        }
        "401" => (
            "unauthenticated",
            "An API key is needed",
            "the API key is unknown, expired or revoked",
        ),
        "403" => {
            ("forbidden", "The request is not allowed", "a page of another site sent this request")
        }
        "404" => ("not-found", "There is no such thing", "there is no such job"),
        "408" => {
            ("too-slow", "The request took too long to arrive", "nothing arrived for 30 seconds")
        }
        "409" => (
            "key-conflict",
            "The idempotency key belongs to another request",
            "this Idempotency-Key was used for another request; use a new key for a new job",
        ),
        "413" => ("too-large", "The request is too large", "uploads may have at most 256 MiB"),
        "415" => (
            "unsupported-media-type",
            "The content type is not supported",
            "send application/json or multipart/form-data, not \"text/plain\"",
        ),
        "416" => (
            "unsatisfiable-range",
            "The file has no such part",
            "the file has 1234 bytes; ask for a range within them",
        ),
        "422" => (
            "invalid-request",
            "The request cannot be met as asked",
            "width: must be between 1 and 8192, is 0",
        ),
        "429" => (
            "over-limit",
            "A limit of this caller is reached",
            "more than 100 requests a second; slow down",
        ),
        "500" => {
            ("internal", "The server failed", "an unexpected fault; the server's log has more")
        }
        "503" => ("unavailable", "The server cannot do this now", "the server is shutting down"),
        _ => return None,
    })
}

/// Shows what each problem looks like.
fn add_example(status: &str, response: &mut Response) {
    let Some((kind, title, detail)) = example_of(status) else { return };
    let Some(RefOr::T(content)) = response.content.get_mut(MEDIA_TYPE) else { return };
    let mut example = json!({
        "type": format!("urn:hemilux:problem:{kind}"),
        "title": title,
        "status": status.parse::<u16>().unwrap_or(500),
        "detail": detail,
        "instance": "/v1/jobs",
        "request_id": "019364d0-5c1e-7b3a-9d55-6a1f0c2b7e11",
    });
    if status == "429" {
        example["limit"] = json!("requests_per_second");
    }
    if status == "422" {
        let errors = json!([{"field": "width", "detail": "must be between 1 and 8192, is 0"}]);
        example["errors"] = errors;
    }
    content.example = Some(example);
}

/// A query or a header has no null: an optional parameter is left out.
fn leave_out_rather_than_null(parameter: &mut RefOr<Parameter>) {
    if let RefOr::T(parameter) = parameter
        && let Some(RefOr::T(Schema::Object(schema))) = &mut parameter.schema
        && let SchemaType::Array(types) = &mut schema.schema_type
    {
        types.retain(|kind| *kind != Type::Null);
        if let [only] = types.as_slice() {
            schema.schema_type = SchemaType::Type(only.clone());
        }
    }
}

/// Says of a multipart form what its further parts are.
fn describe_resources(document: &mut utoipa::openapi::OpenApi, form: &str) {
    let schemas = document.components.as_mut().map(|components| &mut components.schemas);
    let Some(RefOr::T(Schema::Object(form))) = schemas.and_then(|all| all.get_mut(form)) else {
        return;
    };
    let name = ObjectBuilder::new()
        .schema_type(Type::String)
        .pattern(Some("^[A-Za-z0-9._/%-]{1,200}$"))
        .description(Some("A relative URI that the scene names, as it stands there."));
    let file = ObjectBuilder::new()
        .schema_type(Type::String)
        .format(Some(SchemaFormat::KnownFormat(KnownFormat::Binary)));
    form.property_names = Some(Box::new(name.build().into()));
    form.additional_properties = Some(Box::new(file.into()));
}

/// Lists the engine's methods and settings where jobs name them: each setting as `METHOD.NAME`, with
/// the type of its values, and as `NAME` for jobs that name its method.
fn name_the_vocabulary(document: &mut utoipa::openapi::OpenApi) {
    let schemas = document.components.as_mut().map(|components| &mut components.schemas);
    let Some(RefOr::T(Schema::Object(job))) = schemas.and_then(|all| all.get_mut("JobRequest"))
    else {
        return;
    };
    if let Some(RefOr::T(Schema::Object(method))) = job.properties.get_mut("method") {
        let names = worker::METHODS.iter().map(|name| (*name).to_owned().into());
        method.enum_values = Some(names.collect());
    }
    if let Some(RefOr::T(Schema::Object(options))) = job.properties.get_mut("options") {
        let mut of_methods: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for setting in worker::public_settings() {
            of_methods.entry(setting.name).or_default().push(setting.method);
            let name = format!("{}.{}", setting.method, setting.name);
            options.properties.insert(name, setting.schema().into());
        }
        for (name, methods) in of_methods {
            let mut value = Ref::from_schema_name("OptionValue");
            value.description = format!("The setting of that name of {}.", methods.join(", "));
            options.properties.insert(name.to_owned(), RefOr::Ref(value));
        }
        options.additional_properties = Some(Box::new(AdditionalProperties::FreeForm(false)));
    }
}
