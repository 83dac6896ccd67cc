# The program with the versions of constraints.txt. Building needs a network, running does not:
#   docker build -t part2gs-robotics .
#   docker run --rm --network none -v "$PWD:/data" part2gs-robotics build scene/ -o out/
FROM python:3.11-slim-bookworm

# pymeshlab opens libGL, libOpenGL and libX11 at import; MuJoCo draws through EGL. APT in the Makefile.
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        libgl1 libegl1 libegl-mesa0 libgl1-mesa-dri libgles2 libx11-6 libopengl0 \
    && rm -rf /var/lib/apt/lists/*

# Further words for pip, for example another index for torch without CUDA.
ARG PIP_ARGS=""
WORKDIR /opt/part2gs-robotics
COPY constraints.txt pyproject.toml setup.py setup.cfg package.xml README.md LICENSE ./
COPY resource resource
COPY launch launch
COPY part2gs_robotics part2gs_robotics
COPY exporters exporters
COPY sim_checks sim_checks
# Without isolation, so that the package is built with the pinned setuptools as well.
RUN pip install --no-cache-dir $PIP_ARGS -c constraints.txt setuptools \
    && pip install --no-cache-dir $PIP_ARGS -c constraints.txt --no-build-isolation '.[photos,usd]'

RUN useradd --create-home --uid 1000 robot && install -d -o robot /data
USER robot
ENV MUJOCO_GL=egl
WORKDIR /data
ENTRYPOINT ["part2gs-robot"]
CMD ["--help"]
