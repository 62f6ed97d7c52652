"""Benchmark of joint estimation: data sets, evidence, protocols, metrics and reports."""
