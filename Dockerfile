# Mambo on an installed ROS 2 Jazzy (Ubuntu 24.04, apt). The base image is of the Docker library.
#
#   docker build -t mambo .
#   docker run --rm -it -v "$PWD/flights:/home/ubuntu/mambo/bags/own" mambo ./run --output bags/own/circle
FROM ros:jazzy-ros-base

RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        build-essential git python3-dev python3-venv ros-jazzy-tf2-msgs \
    && rm -rf /var/lib/apt/lists/*

USER ubuntu
WORKDIR /home/ubuntu/mambo
COPY --chown=ubuntu . .
RUN bash -c 'source env.bash'

CMD ["bash", "-c", "source env.bash && exec bash"]
