//! The job service.
