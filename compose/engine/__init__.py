# SPDX-License-Identifier: Apache-2.0
"""What compose/hosts is made of: file (what a compose file says), network (namespaces and bridges), container (one
service's process and all that is around it), project (who is started when, watched, restarted and ended)."""
