//! The log, as text or JSON, and traces for OpenTelemetry where the feature `otel` is built in.

use crate::trace_context::TraceParent;
use clap::ValueEnum;
use std::io::IsTerminal;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// How the log is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// Lines for people.
    #[default]
    Text,
    /// One JSON object a line, with the spans that it lies in.
    Json,
}

/// Keeps what collects traces alive; dropping it sends what is left.
#[must_use]
pub struct Telemetry {
    #[cfg(feature = "otel")]
    provider: Option<opentelemetry_sdk::trace::SdkTracerProvider>,
}

/// Starts the log on standard error. `RUST_LOG` says what goes in, `default` where it is not set.
pub fn start(format: LogFormat, default: &str) -> Telemetry {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    let text = (format == LogFormat::Text).then(|| {
        tracing_subscriber::fmt::layer()
            .with_writer(std::io::stderr)
            .with_ansi(std::io::stderr().is_terminal())
    });
    let json = (format == LogFormat::Json)
        .then(|| tracing_subscriber::fmt::layer().json().with_writer(std::io::stderr));
    let registry = tracing_subscriber::registry().with(filter).with(text).with(json);
    #[cfg(not(feature = "otel"))]
    {
        registry.init();
        Telemetry {}
    }
    #[cfg(feature = "otel")]
    {
        let provider = otel::provider();
        let traces = provider.as_ref().map(otel::layer);
        registry.with(traces).init();
        Telemetry { provider }
    }
}

/// Makes `span` part of the trace that `parent` names.
pub fn continue_trace(span: &tracing::Span, parent: &TraceParent) {
    #[cfg(feature = "otel")]
    otel::continue_trace(span, parent);
    #[cfg(not(feature = "otel"))]
    let _ = (span, parent);
}

#[cfg(feature = "otel")]
impl Drop for Telemetry {
    fn drop(&mut self) {
        if let Some(provider) = self.provider.take()
            && let Err(error) = provider.shutdown()
        {
            eprintln!("hemilux: traces were lost: {error}");
        }
    }
}

#[cfg(feature = "otel")]
mod otel {
    use crate::trace_context::TraceParent;
    use opentelemetry::trace::{
        SpanContext, SpanId, TraceContextExt, TraceFlags, TraceId, TraceState, TracerProvider,
    };
    use opentelemetry::{Context, KeyValue};
    use opentelemetry_sdk::Resource;
    use opentelemetry_sdk::trace::SdkTracerProvider;
    use tracing_opentelemetry::OpenTelemetrySpanExt;

    /// Sends traces where `OTEL_EXPORTER_OTLP_ENDPOINT` says; nowhere without it.
    pub fn provider() -> Option<SdkTracerProvider> {
        std::env::var_os("OTEL_EXPORTER_OTLP_ENDPOINT")?;
        let exporter = opentelemetry_otlp::SpanExporter::builder().with_http().build();
        match exporter {
            Ok(exporter) => {
                let version = KeyValue::new("service.version", env!("CARGO_PKG_VERSION"));
                let resource = Resource::builder()
                    .with_service_name("hemilux")
                    .with_attribute(version)
                    .build();
                let provider = SdkTracerProvider::builder()
                    .with_batch_exporter(exporter)
                    .with_resource(resource);
                Some(provider.build())
            }
            Err(error) => {
                eprintln!("hemilux: no traces are sent: {error}");
                None
            }
        }
    }

    pub fn layer<S>(
        provider: &SdkTracerProvider,
    ) -> tracing_opentelemetry::OpenTelemetryLayer<S, opentelemetry_sdk::trace::SdkTracer>
    where
        S: tracing::Subscriber + for<'span> tracing_subscriber::registry::LookupSpan<'span>,
    {
        tracing_opentelemetry::layer().with_tracer(provider.tracer("hemilux"))
    }

    pub fn continue_trace(span: &tracing::Span, parent: &TraceParent) {
        let ids = (TraceId::from_hex(parent.trace_id()), SpanId::from_hex(parent.parent_id()));
        let (Ok(trace), Ok(sender)) = ids else { return };
        let sampled = parent.as_str().ends_with('1');
        let flags = if sampled { TraceFlags::SAMPLED } else { TraceFlags::default() };
        let context = SpanContext::new(trace, sender, flags, true, TraceState::default());
        // A span that is not recorded has no parent either.
        let _ = span.set_parent(Context::new().with_remote_span_context(context));
    }
}
