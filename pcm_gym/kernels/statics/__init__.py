"""One mechanism at rest: closure and equilibrium, Newton, stability, margins, and what is known of an equilibrium."""
