"""What people look at: a live robot in the browser, and races as pages to replay."""
