# pcm_gym with its kernels compiled: `docker build -t pcm-gym .`, then `docker run --rm pcm-gym fk 2RFR`.
# Training: `docker build --build-arg EXTRAS=agents,render -t pcm-gym .`
FROM python:3.13-slim

ARG EXTRAS=render
ENV PIP_NO_CACHE_DIR=1 PYTHONUNBUFFERED=1

# The user owns the kernels: where the processor is of another kind than at the build, they are compiled anew.
RUN useradd --create-home user
WORKDIR /home/user/pcm_gym
COPY --chown=user . .
RUN pip install --editable ".[${EXTRAS}]"

USER user
RUN pcm-gym warmup
WORKDIR /home/user
ENTRYPOINT ["pcm-gym"]
CMD ["--help"]
