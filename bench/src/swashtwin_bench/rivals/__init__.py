"""Classifiers that studies compare with."""

from swashtwin_bench.rivals import networks as networks
