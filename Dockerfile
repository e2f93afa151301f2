# The competition's entry: docker run IMAGE <domain> <instance> <method> <episodes>
#
#   docker build --tag mdpo-rddl .
#   docker run --rm --volume "$PWD/outputs:/outputs" mdpo-rddl HVAC 1 mdpo 50
#
# Small by construction: a slim base, JAX for CPUs, no compiler, no cache, no development tools.
# The build fails if the packages outgrow their share of 2 GB.
FROM python:3.11-slim-bookworm AS build
RUN python -m venv /opt/venv
WORKDIR /source
COPY constraints.txt pyproject.toml setup.py README.md LICENSE ./
COPY domains domains
COPY instances instances
COPY mdpo_rddl mdpo_rddl
RUN /opt/venv/bin/pip install --no-cache-dir --disable-pip-version-check --no-compile \
      --constraint constraints.txt . \
    && test "$(du --summarize --block-size=1M /opt/venv | cut --fields 1)" -lt 1600

FROM python:3.11-slim-bookworm
COPY --from=build /opt/venv /opt/venv
# an ordinary user, for whose number a mounted folder must be writable
RUN useradd --uid 1000 --create-home planner && install --directory --owner planner /outputs
USER planner
WORKDIR /home/planner
ENV JAX_PLATFORMS=cpu
VOLUME /outputs
# in full, as Singularity needs it
ENTRYPOINT ["/opt/venv/bin/mdpo-ipc", "agent", "--out", "/outputs"]
