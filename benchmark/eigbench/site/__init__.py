"""The leaderboard as a static page: the results of LEADERBOARD.md, to sort, filter and open."""
