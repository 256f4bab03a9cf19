"""Tests of the thesis remade."""
