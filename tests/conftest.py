"""Settings of all tests."""

from hypothesis import settings

# The first call of a kernel compiles it, and a check that runs on every push must not depend on chance.
settings.register_profile("pcm_gym", deadline=None, derandomize=True)
settings.load_profile("pcm_gym")
