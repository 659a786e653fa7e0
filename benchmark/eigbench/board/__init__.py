"""From results to LEADERBOARD.md: ranking, tables and figures."""
