# SPDX-License-Identifier: Apache-2.0
"""How long a test waits before it fails: tests/support/deadline.hpp says why."""

DEADLINE_S = 300
