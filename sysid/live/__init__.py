"""A measurement while it runs: a phone read over the network, releases as they end, and the next step."""
