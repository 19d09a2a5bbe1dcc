"""Attacks on the package by seeded cases: weight files, bags, messages, requests, killed verbs and full disks."""
