"""The benchmark: ids and tiers, times learners and references, times seeds.

To be read in this order: `tiers` are what there is to be learnt; `config` says which of them, who learns, and so which
cells there are. `cells` is what one cell comes to and the folder that holds all; `work` trains and judges one, and
`processes` does many, each in a process of its own, alone in their folder by its `lock`. `scores` makes one table of
all cells, and `page` a page of it.
"""
