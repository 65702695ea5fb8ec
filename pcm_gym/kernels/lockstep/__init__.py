"""Many mechanisms in lock-step: natural steps and margins in lanes of vector instructions."""
