"""The paper's study: six methods side by side, their table and figures."""
