# surgeon
