"""What learns: algorithms, the environments they learn on, and the policies that come of it.

To be read in this order: `algorithms` is the table of what can be chosen by name, `settings` what a learner is told.
`batches` makes environments and `vector_adapter` puts them before Stable-Baselines3, with `infos` that are read as
arrays. `hyperparameters` turns plain data into arguments, `features` is what networks see, `fast_ppo` is PPO with a
loop for large batches and `surrogate` its loss. `learner` makes, saves and loads a learner, `policy` acts as it has
learnt. Beside the learning, `callbacks` keep statistics and snapshots and `lagrangian` weighs the cost; `progress` is
the learning curve on disk, `files` what a snapshot consists of and `provenance` who wrote it. `export` makes policies
of plain numbers.
"""
