# The server in a small image: the CPU device renders without any driver.
#
#   docker build -t hemilux .
#   docker run -d --name hemilux -p 127.0.0.1:8080:8080 -v hemilux-data:/data hemilux
#   docker exec hemilux hemilux keys --data-dir /data add NAME    # prints the first API key
#
# Both bases are of one Debian release, so that the program finds the C library it was linked to.
ARG BUILD_BASE=docker.io/library/rust:1.95-slim-trixie
ARG RUNTIME_BASE=docker.io/library/debian:trixie-slim

# Any base will do that holds the Rust toolchain, a C compiler and the C library's headers.
FROM ${BUILD_BASE} AS build
WORKDIR /build
# rust-toolchain.toml stays out: the compiler is the base's, and Cargo.toml says how new it must be.
COPY Cargo.toml Cargo.lock ./
COPY crates crates
COPY bench bench
COPY tests tests
COPY scenes scenes
RUN CARGO_PROFILE_RELEASE_STRIP=symbols cargo build --release --locked --bin hemilux

FROM ${RUNTIME_BASE}
LABEL org.opencontainers.image.title="Hemilux" \
      org.opencontainers.image.description="Render server: physically correct light for glTF scenes" \
      org.opencontainers.image.licenses="MIT OR Apache-2.0"
# A fixed user, so that the owner of files on a volume stays the same from image to image.
RUN groupadd --gid 10001 hemilux \
    && useradd --uid 10001 --gid 10001 --no-create-home --home-dir /data --shell /usr/sbin/nologin hemilux \
    && install -d -o hemilux -g hemilux /data
COPY LICENSE-APACHE LICENSE-MIT /usr/share/doc/hemilux/
COPY --from=build /build/target/release/hemilux /usr/local/bin/hemilux
USER 10001:10001
WORKDIR /data
VOLUME /data
EXPOSE 8080
HEALTHCHECK --interval=10s --timeout=5s --start-period=10s CMD ["hemilux", "health"]
ENTRYPOINT ["hemilux"]
# Inside a container every address is remote, and a port that is published to this machine alone is
# still reached by every web page that its browsers show: so API keys are asked for.
CMD ["serve", "--listen", "0.0.0.0:8080", "--require-keys", "--data-dir", "/data"]
