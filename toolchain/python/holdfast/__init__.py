# SPDX-License-Identifier: Apache-2.0
"""The serial link (holdfast.link) and the logs (holdfast.logs) of Holdfast."""
