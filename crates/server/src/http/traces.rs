//! How the figures of a job moved: numbers as JSON and CSV, the error against time as a chart.

use super::app::App;
use super::documented;
use super::jobs::find;
use super::problem::Problem;
use super::read::{JobId, is_held, prefers};
use crate::api::jobs::{ErrorBounds, ErrorSource, Figures, Job, Progress, Trace, TracePoint};
use crate::hash::sha256_hex;
use crate::job_state::JobState;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use hemilux_charts::chart::{Chart, Level, Line, Panel};
use std::fmt::Write;
use uuid::Uuid;

const SVG: &str = "image/svg+xml";
const JSON: &str = "application/json";
const CSV: &str = "text/csv; charset=utf-8";
/// Width and height of the chart, pixels.
const CHART: (u32, u32) = (640, 360);

/// The estimated error against the seconds of solving, drawn.
///
/// Both axes are logarithmic, so noise that falls with the square root of time is a straight
/// line. A target error is a dotted line. A job without estimates has a chart that says so.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/chart.svg", tag = "results", params(documented::OfJob),
    responses(
        (
            status = 200, description = "The chart.", body = String, content_type = "image/svg+xml",
            headers(("etag" = String, description = "Names the content.")),
            example = json!("<svg width=\"640\" height=\"360\" viewBox=\"0 0 640 360\" xmlns=\"http://www.w3.org/2000/svg\">…</svg>")
        ),
        documented::NamedOrNewest,
    )
)]
pub async fn chart_svg(
    State(app): State<App>,
    JobId(id): JobId,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = find(&app, id).await?;
    let svg = chart(&job, &app.shared.store.trace(id).await?).svg().map_err(Problem::internal)?;
    Ok(send(&headers, SVG, svg.into_bytes()))
}

/// How a job's figures moved, as JSON, or as CSV where `Accept` prefers text/csv.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/trace", tag = "results", params(documented::OfJob),
    responses(
        (
            status = 200, description = "The figures.",
            content(
                (Trace = "application/json", example = json!(example())),
                (String = "text/csv", example = json!(as_csv(&example())))
            ),
            headers(("etag" = String, description = "Names the content."))
        ),
        documented::NamedOrNewest,
    )
)]
pub async fn trace(
    State(app): State<App>,
    JobId(id): JobId,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let trace = read_trace(&app, id).await?;
    let mut response = if prefers(&headers, "text/csv", JSON) {
        send(&headers, CSV, as_csv(&trace).into_bytes())
    } else {
        send(&headers, JSON, as_json(&trace)?)
    };
    response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    Ok(response)
}

/// How a job's figures moved, as JSON.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/trace.json", tag = "results", params(documented::OfJob),
    responses(
        (
            status = 200, description = "The figures.", body = Trace,
            headers(("etag" = String, description = "Names the content.")),
            example = json!(example())
        ),
        documented::NamedOrNewest,
    )
)]
pub async fn trace_json(
    State(app): State<App>,
    JobId(id): JobId,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    Ok(send(&headers, JSON, as_json(&read_trace(&app, id).await?)?))
}

/// How a job's figures moved, as CSV.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/trace.csv", tag = "results", params(documented::OfJob),
    responses(
        (
            status = 200, description = "The figures.", body = String, content_type = "text/csv",
            headers(("etag" = String, description = "Names the content.")),
            example = json!(as_csv(&example()))
        ),
        documented::NamedOrNewest,
    )
)]
pub async fn trace_csv(
    State(app): State<App>,
    JobId(id): JobId,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    Ok(send(&headers, CSV, as_csv(&read_trace(&app, id).await?).into_bytes()))
}

/// A trace for the API's description.
fn example() -> Trace {
    let point = |seconds, iterations, ratio, error: Option<f64>| TracePoint {
        seconds,
        figures: Figures {
            iterations,
            shots: 8 * iterations,
            light_source_selection_ratio: ratio,
            estimated_error: error,
            error_bounds: error.map(|error| ErrorBounds {
                low: 0.67 * error,
                high: 1.5 * error,
                by: ErrorSource::Scatter,
            }),
        },
    };
    Trace {
        job: Uuid::from_u128(0x0193_6f3e_8a51_7c3e_b1a4_6f2d_7a7b_6c01),
        points: vec![point(0.21, 4, 0.5625, None), point(0.84, 48, 0.5495, Some(0.0718))],
    }
}

async fn read_trace(app: &App, id: Uuid) -> Result<Trace, Problem> {
    find(app, id).await?;
    let points = app.shared.store.trace(id).await?.into_iter();
    let points = points.map(|Progress { seconds, figures, .. }| TracePoint { seconds, figures });
    Ok(Trace { job: id, points: points.collect() })
}

fn as_json(trace: &Trace) -> Result<Vec<u8>, Problem> {
    serde_json::to_vec(trace).map_err(|error| Problem::internal(error.to_string()))
}

fn as_csv(trace: &Trace) -> String {
    let mut text = String::from(
        "seconds,iterations,shots,light_source_selection_ratio,estimated_error,error_low,error_high\n",
    );
    for point in &trace.points {
        let TracePoint { seconds, figures } = point;
        let Figures { iterations, shots, light_source_selection_ratio: ratio, .. } = figures;
        let bounds = figures.error_bounds;
        let errors = [
            figures.estimated_error,
            bounds.map(|bounds| bounds.low),
            bounds.map(|bounds| bounds.high),
        ];
        let [error, low, high] =
            errors.map(|error| error.map(|error| error.to_string()).unwrap_or_default());
        let _ = writeln!(text, "{seconds},{iterations},{shots},{ratio},{error},{low},{high}");
    }
    text
}

fn chart(job: &Job, trace: &[Progress]) -> Chart {
    let method = job.plan.as_ref().map_or(&job.request.method, |plan| &plan.method);
    let estimated = trace.iter().filter_map(|p| Some((p.seconds, p.figures.estimated_error?)));
    let line = Line { name: method.clone(), points: estimated.collect(), ..Line::default() };
    let target = job.request.target_error.map(|value| {
        let percent = format!("{:.3}", 100.0 * value);
        let percent = percent.trim_end_matches('0').trim_end_matches('.');
        Level { name: format!("target {percent} %"), value }
    });
    let empty = match job.state {
        JobState::Queued => "waiting for a device: no estimates yet",
        JobState::Running => "no estimates yet",
        _ => "the job ended without an error estimate",
    };
    let panel = Panel {
        title: format!("{method}: estimated error"),
        x_label: "seconds of solving".into(),
        y_label: "estimated rRMSE".into(),
        lines: vec![line],
        levels: target.into_iter().collect(),
        y_percent: true,
        empty: empty.into(),
        ..Panel::default()
    };
    Chart { panels: vec![panel], columns: 1, panel_size: CHART, legend: false }
}

/// An answer that a client may keep and ask about again. The tag is weak: the same text may
/// travel compressed.
fn send(headers: &HeaderMap, media_type: &'static str, body: Vec<u8>) -> Response {
    let etag = format!("\"{}\"", sha256_hex(&body));
    let tags =
        [(header::ETAG, format!("W/{etag}")), (header::CACHE_CONTROL, "no-cache".to_owned())];
    if is_held(headers, &etag) {
        return (StatusCode::NOT_MODIFIED, tags).into_response();
    }
    (tags, [(header::CONTENT_TYPE, media_type)], body).into_response()
}
