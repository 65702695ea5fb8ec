"""Many mechanisms in lock-step: natural steps and margins of blocks of rows, with vector instructions.

A lane is the place of one row in a block; a run is one quantity over all lanes. The symbols are those of `statics`,
whose formulas are used: here is only loading, storing and the order of work.

To be read in this order: `layout` (where the numbers of a block stand), `rows` (rows into lanes and back), `verdicts`
(index and stability margin), `lanes` (the step), `lanes_margin` (the singularity margin),
`lanes_gradient` (derivatives by the inputs).
"""
