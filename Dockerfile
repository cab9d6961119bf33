# The simulated cell with its page in the browser, for systems other than Debian 12:
#
#     docker build -t skiros2 .
#     docker run --rm -p 127.0.0.1:8765:8765 -p 127.0.0.1:8766:8766 skiros2
#
# It prints the address of the page and a token. tests/long/test_clean_debian.py does the same steps.
FROM debian:bookworm-slim
RUN apt-get update && apt-get install --yes --no-install-recommends ca-certificates make socat \
    && rm -rf /var/lib/apt/lists/*
COPY . /skiros2
WORKDIR /skiros2
RUN make setup FOR="run planner sim gateway page" && rm -rf build/stage ~/.cache /var/cache/apt/archives /var/lib/apt/lists/*
RUN useradd --create-home skiros
USER skiros
EXPOSE 8765 8766
CMD ["/skiros2/.ci/container"]
