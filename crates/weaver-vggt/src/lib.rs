//! DINOv2-style patch encoder, alternating-attention aggregator and DPT heads.
