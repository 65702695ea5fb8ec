"""Names of the files that make a snapshot of a learner."""

MODEL = "model.zip"
NORMALISATION = "normalisation.pkl"
REPLAY_BUFFER = "replay_buffer.pkl"
PICKLES = (MODEL, NORMALISATION, REPLAY_BUFFER)
