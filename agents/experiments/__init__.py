"""What is to be learnt, and what is kept of it.

To be read in this order: `config` is one experiment, as a YAML file describes it, and `learners` makes one from an
id and the name of a learner; `runs` is the folder of a training run; `training` leads from the one to the other;
`export` makes a policy of what is there. `files` are written whole or not at all, `machine` is what they were made on.
"""
