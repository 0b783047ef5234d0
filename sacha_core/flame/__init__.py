"""The head prior: model file, conversion of rigs and licensed pickles, posing, teeth, and the synthetic head."""
